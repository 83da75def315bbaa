# SPDX-License-Identifier: Apache-2.0
"""The cases that break cloth simulators, with what is expected of each; `cama stability` runs them.

See docs/reference/stability.md.

`table.CHECKS` lists them all.  `scene_cases.CASES` are whole scenes; `inputs`, `meshes`, `materials`, `collisions` and
`running` hold what needs a few steps or a single call.
"""
