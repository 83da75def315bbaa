# SPDX-License-Identifier: Apache-2.0
"""Scenes that `cama new` writes. NAME stands for the name of the scene."""

SHEET = """\
// A sheet falls on a sphere. Lengths are in metres, masses in kilograms, times in seconds; z is up.
{
  "$schema": "schema.json",  // editors complete and check keys with it
  "name": NAME,
  "frame_time": 0.02,  // between recorded frames
  "frames": 75,
  "resolution": 2000,  // triangles of all generated cloth together; more are finer and slower

  // What cloth collides with. In place of "sphere": "box", "capsule", "plane", "walker",
  // or a mesh: "file": {"path": "body.obj", "units": "cm", "up": "y"}.
  "obstacles": [
    {"name": "ball", "sphere": {"radius": 0.25, "triangles": 1500}, "friction": 0.3}
  ],

  // In place of "grid": "tube", "garment", or a mesh: "file": {"path": "shirt.obj"}.
  "cloth": [
    {
      "name": "sheet",
      "grid": {"size": [1, 1]},
      "material": "cotton",  // `cama info` lists the fabrics
      "transform": {"translate": [0, 0, 0.27]}  // starts just above the ball
    }
  ],

  // Vertices that are held: here two corners, until 0.4 s. Leave "release" out to hold them for good.
  "pins": [
    {"cloth": "sheet", "corners": ["top_left", "top_right"], "release": 0.4}
  ]
}
"""

FLAG = """\
// A flag in the wind. Lengths are in metres, masses in kilograms, times in seconds; z is up.
{
  "$schema": "schema.json",  // editors complete and check keys with it
  "name": NAME,
  "frame_time": 0.02,  // between recorded frames
  "frames": 100,
  "resolution": 1500,  // triangles of all generated cloth together; more are finer and slower

  // Velocity in m/s; density of the air in kg/m^3; drag along the cloth in kg/(m^2 s).
  "wind": {"velocity": [6, 0.5, 0], "density": 1.2, "drag": 0.03},

  // A fabric of this scene: a shipped one with other numbers. `cama info` lists the fabrics.
  "materials": {
    "flag": {"fabric": "silk", "density": 0.09}
  },

  "cloth": [
    {
      "name": "flag",
      // Upright, and with a ripple of 4 mm: the wind needs something to begin with.
      "grid": {"size": [1.5, 1], "plane": "xz", "ripple": {"amplitude": 0.004, "wavelength": 0.6}},
      "material": "flag",
      "transform": {"translate": [0.75, 0, 1.5]}
    }
  ],

  // The edge along the pole is held. Others: "right", "top", "bottom"; or "corners", "vertices", "box".
  "pins": [
    {"cloth": "flag", "edge": "left"}
  ]
}
"""

GARMENT = """\
// A skirt on a walking body. Lengths are in metres, masses in kilograms, times in seconds; z is up.
{
  "$schema": "schema.json",  // editors complete and check keys with it
  "name": NAME,
  "frame_time": 0.02,  // between recorded frames
  "frames": 100,
  "resolution": 3000,  // triangles of all generated cloth together; more are finer and slower
  "contact": {"thickness": 0.0015},  // cloth stays this far from the body

  // A generated body. For one of your own:
  // "character": {"file": "body.glb", "lead_in": 1, "leave_out": ["left_arm", "right_arm"]}.
  "obstacles": [
    {"name": "body", "walker": {"height": 1.7, "duration": 2}, "friction": 0.3}
  ],

  // A garment is fitted around its body. Heights (waist, hip) are z coordinates. Sewn panels in place of it:
  // "file": {"path": "skirt.obj", "rest": "uv", "material_scale": 0.01}, with the pattern as texture coordinates.
  "cloth": [
    {
      "name": "skirt",
      "garment": {"skirt": {"body": "body", "waist": 1.06, "hip": 0.97, "length": 0.52, "panels": 8}},
      "material": "wool"  // `cama info` lists the fabrics
    }
  ],

  // The waist follows the body's surface.
  "pins": [
    {"cloth": "skirt", "edge": "waist", "attach": "body"}
  ]
}
"""

OUTFIT = """\
// A skirt, and a top over it, on a body that dances. Lengths are in metres, masses in kilograms, times in seconds.
{
  "$schema": "schema.json",  // editors complete and check keys with it
  "name": NAME,
  "frame_time": 0.02,  // between recorded frames
  "frames": 150,
  "resolution": 3000,  // triangles of all generated cloth together; more are finer and slower
  "contact": {"thickness": 0.0015},  // cloth stays this far from the body

  // A generated body: "stand", "walk", "dance", "kick" or "turn". It begins with its arms away from the trunk, and
  // moves into the dance within "lead_in". For one of your own: "character": {"file": "body.glb", "lead_in": 1}.
  "obstacles": [
    {"name": "body", "body": {"motion": "dance", "height": 1.7, "lead_in": 1}, "friction": 0.3}
  ],

  // Garments are fitted around the body; "clearance" is their distance from it: the outer layer has the larger one.
  "cloth": [
    {
      "name": "skirt",
      "garment": {"skirt": {"body": "body", "waist": 1.06, "hip": 0.95, "length": 0.5, "clearance": 0.006}},
      "material": "wool"  // `cama info` lists the fabrics
    },
    {
      "name": "top",
      "garment": {"dress": {"body": "body", "chest": 1.28, "hip": 0.98, "length": 0.32, "flare": 0, "clearance": 0.03}},
      "material": "cotton"
    }
  ],

  // The upper rings follow the body's surface.
  "pins": [
    {"cloth": "skirt", "edge": "waist", "attach": "body"},
    {"cloth": "top", "edge": "waist", "attach": "body"}
  ]
}
"""

TEMPLATES = {"sheet": SHEET, "flag": FLAG, "garment": GARMENT, "outfit": OUTFIT}
