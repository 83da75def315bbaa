# SPDX-License-Identifier: Apache-2.0
"""A robot of MuJoCo lifts a towel and feels its weight: `python examples/10_mujoco.py`.

Before every time step of the towel the robot moves on by the same time: poses of its fingers go in, and forces of the
towel on them come out.
"""

import mujoco
import numpy as np
from gripper import CENTRE, OPEN, PAD, THICKNESS, Hand, towel_scene

import cama

RATE, SUBSTEPS = 240, 4  # time steps a second of the towel; of the robot in each of them
CLOSE, LIFT, HOLD = 0.7, 1.5, 1.5  # s
HEIGHT = 0.3  # m

# A hand that slides up and down and two fingers that slide in it. Its servos compensate its own weight.
ROBOT = f"""
<mujoco>
  <option timestep="{1 / (RATE * SUBSTEPS)}" integrator="implicitfast"/>
  <default> <geom contype="0" conaffinity="0"/> </default>
  <worldbody>
    <body name="hand" pos="{CENTRE[0]} 0 0" gravcomp="1">
      <joint name="lift" type="slide" axis="0 0 1" damping="40"/>
      <geom type="box" size="0.01 0.03 0.02" pos="0.03 0 0" mass="0.5"/>
      <body name="lower" pos="0 0 {-(OPEN + PAD[2]) / 2}" gravcomp="1">
        <joint name="lower" type="slide" axis="0 0 1" damping="20"/>
        <geom type="box" size="{PAD[0] / 2} {PAD[1] / 2} {PAD[2] / 2}" mass="0.05"/>
      </body>
      <body name="upper" pos="0 0 {(OPEN + PAD[2]) / 2}" gravcomp="1">
        <joint name="upper" type="slide" axis="0 0 -1" damping="20"/>
        <geom type="box" size="{PAD[0] / 2} {PAD[1] / 2} {PAD[2] / 2}" mass="0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="lift" kp="1000"/>
    <position joint="lower" kp="2000"/>
    <position joint="upper" kp="2000"/>
  </actuator>
</mujoco>
"""
FINGERS = ("lower", "upper")

model = mujoco.MjModel.from_xml_string(ROBOT)
robot = mujoco.MjData(model)
mujoco.mj_forward(model, robot)
simulation = cama.Simulation(towel_scene(), accuracy="production", time_step=1 / RATE, forces=True)
hand = Hand(simulation)  # only for the force between the pads
body = {name: model.body(name).id for name in FINGERS}
start = {name: robot.xpos[body[name]].copy() for name in FINGERS}


def targets(time):
    """Of the servos, m: lift, lower and upper finger."""
    close = min(time / (0.8 * CLOSE), 1) * (OPEN - 1.6 * THICKNESS) / 2
    way = np.clip((time - CLOSE) / LIFT, 0, 1)
    return HEIGHT * way * way * (3 - 2 * way), close, close


def before_step(now):
    """Lets the robot move for the time of a step under the forces of the last one, then places the pads."""
    for name in FINGERS:
        wrench = now.force_on(name, about=robot.xpos[body[name]])
        robot.xfrc_applied[body[name]] = [*wrench.force, *wrench.torque]
    robot.ctrl[:] = targets(now.time)
    for _ in range(SUBSTEPS):
        mujoco.mj_step(model, robot)
    mujoco.mj_kinematics(model, robot)
    for name in FINGERS:  # they do not turn: with a turn R the translation is xpos - R start
        now.set_obstacle_pose(name, robot.xpos[body[name]] - start[name], robot.xquat[body[name]])


simulation.before_step = before_step
intersections = 0
felt = []
for _ in range(round((CLOSE + LIFT + HOLD) * 60)):
    simulation.step(RATE // 60)
    intersections += simulation.count_intersections()
    felt.append(robot.actuator_force[0])

towel = simulation.positions[: simulation.cloth_vertex_count]
print(f"weight of the towel: {9.81 * simulation.masses.sum():.5f} N")
print(f"force of the lift servo, mean of the last second: {np.mean(felt[-60:]):.5f} N")
print(f"pads press with: {hand.pressing():.3f} N")
print(f"lowest point of the towel: {towel[:, 2].min():.3f} m, fingers at {robot.xpos[body['lower']][2]:.3f} m")
print(f"intersections: {intersections}")
