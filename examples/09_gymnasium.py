# SPDX-License-Identifier: Apache-2.0
"""Lifting a towel as an environment of Gymnasium, alone and many at once: `python examples/09_gymnasium.py`.

An action moves the hand of `gripper.py` along x and z, turns it, and opens or closes it, for a fifteenth of a second.
The reward of a step is by how much it lifted the towel, in towel lengths. An episode ends after 60 actions.
"""

import argparse

import gymnasium
import numpy as np
from gripper import CENTRE, OPEN, PADS, PRESS, SIDE, THICKNESS, normal, pad_pose, towel_scene
from gymnasium.utils.seeding import np_random
from gymnasium.vector.utils import batch_space

import cama

STEPS = 16  # time steps of an action
RATE = 240  # time steps a second
LENGTH = 60  # actions
REACH = np.array([0.01, 0.015, 0.1])  # m, m, radians: the most that an action changes x, z and the angle
OBSERVED = np.array([i * 16 + k for i in (0, 7, 15) for k in (0, 7, 15)])  # vertices of the towel, of 16 x 16
OBSERVATION = gymnasium.spaces.Box(-np.inf, np.inf, (3 * len(OBSERVED) + 5,), np.float64)
ACTION = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
OPTIONS = {"accuracy": "production", "time_step": 1 / RATE, "forces": True, "backend": "cpu"}


class Task:
    """What the hands and towels of all worlds do, and how they are seen and judged: one call for all worlds."""

    def __init__(self, number: int) -> None:
        self.worlds = cama.Worlds(towel_scene(cells=15), number, **OPTIONS)
        first = self.worlds[0]
        self.flat = first.scene.cloths[0].vertices
        self.share = first.masses / first.masses.sum()  # of a vertex in the mass
        self.position, self.angle, self.gap = np.tile(CENTRE, (number, 1)), np.zeros(number), np.full(number, OPEN)
        self.actions, self.height = np.zeros(number, int), np.zeros(number)

    def begin(self, worlds, randoms) -> None:
        """Begins episodes: a towel hangs over the edge by 3 to 4 cm, and a hand is up to 5 mm from its place.

        Args:
            worlds: Their numbers [k].
            randoms: A generator for each of them.
        """
        self.worlds.reset(worlds)
        drawn = [(own.uniform(0, 0.01), own.uniform(-0.005, 0), own.uniform(-0.003, 0.003)) for own in randoms]
        back, x, z = np.array(drawn).T
        zero = np.zeros_like(back)
        towels = self.flat - np.stack([back, zero, zero], -1)[:, None]
        self.worlds.set_state(towels, np.zeros_like(towels), worlds=worlds)
        self.position[worlds] = CENTRE + np.stack([x, zero, z], -1)
        self.angle[worlds], self.gap[worlds], self.actions[worlds] = 0, OPEN, 0
        self.height[worlds] = self.heights(self.towels())[worlds]

    def towels(self):
        """Positions [worlds, vertices, 3], m."""
        return self.worlds.positions[:, : len(self.flat)]

    def heights(self, towels):
        """Mean heights above the table [worlds], m."""
        return (towels[..., 2] * self.share).sum(-1)

    def act(self, actions, worlds) -> None:
        """Gives pads their targets: x, z, angle and gap. actions: [all worlds, 4]; worlds: those that act."""
        actions = np.clip(np.asarray(actions, np.float64), -1, 1)[worlds]
        x, z, turn = (actions[:, :3] * REACH).T
        moved = self.position[worlds] + np.stack([x, np.zeros_like(x), z], -1)
        self.position[worlds] = np.clip(moved, CENTRE - [0.1, 0, 0.005], CENTRE + [0.05, 0, 0.5])
        self.angle[worlds] = np.clip(self.angle[worlds] + turn, 0, np.pi / 2)
        self.gap[worlds] = np.clip(self.gap[worlds] + 0.006 * actions[:, 3], 1.7 * THICKNESS, OPEN)
        for name, side in PADS:
            pose = pad_pose(side, self.position[worlds], self.angle[worlds], self.gap[worlds])
            self.worlds.set_obstacle_pose(name, *pose, duration=STEPS / RATE, worlds=worlds)

    def judge(self, towels, worlds):
        """Rewards of the last actions of worlds, and whether their episodes are over."""
        self.actions[worlds] += 1
        before = self.height[worlds]
        self.height[worlds] = self.heights(towels)[worlds]
        return (self.height[worlds] - before) / SIDE, self.actions[worlds] == LENGTH

    def observe(self, towels):
        """Points of towels, hands' x, z, angle and gap, and the forces of their pads, about 1 in size; [worlds, 32]."""
        lower, upper = ((self.worlds.force_on(name).force * normal(self.angle)).sum(-1) for name, _ in PADS)
        x, _, z = (self.position - CENTRE).T / SIDE
        own = np.stack([x, z, self.angle, self.gap / OPEN, np.minimum(-lower, upper) / PRESS], -1)
        return np.concatenate([towels[:, OBSERVED].reshape(len(towels), -1) / SIDE, own], -1)


class LiftTowel(gymnasium.Env):
    """One towel."""

    metadata = {"render_modes": []}
    observation_space, action_space = OBSERVATION, ACTION

    def __init__(self) -> None:
        self.task = Task(1)

    def observe(self):
        return self.task.observe(self.task.towels())[0]

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.task.begin([0], [self.np_random])
        return self.observe(), {}

    def step(self, action):
        self.task.act([action], [0])
        self.task.worlds.step(STEPS)
        if self.task.worlds.frozen:  # what is asked of the cloth cannot be computed
            return self.observe(), -1.0, True, False, {"error": str(self.task.worlds.error(0))}
        (reward,), (over,) = self.task.judge(self.task.towels(), [0])
        return self.observe(), float(reward), False, bool(over), {}


class LiftTowels(gymnasium.vector.VectorEnv):
    """Many towels that advance together; every one has the bits of a LiftTowel with its seed.

    An episode that is over begins anew with the next step, whose action is not used (gymnasium's AutoresetMode
    NEXT_STEP).
    """

    metadata = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

    def __init__(self, number: int) -> None:
        self.num_envs = number
        self.single_observation_space, self.single_action_space = OBSERVATION, ACTION
        self.observation_space = batch_space(OBSERVATION, number)
        self.action_space = batch_space(ACTION, number)
        self.task = Task(number)
        self.worlds = self.task.worlds
        self.over = np.zeros(number, bool)
        self.randoms = [None] * number

    def reset(self, *, seed=None, options=None):
        """Begins all episodes. World k has the seed of a LiftTowel with seed + k; or give a list of seeds."""
        numbers = range(self.num_envs)
        seeds = seed if isinstance(seed, (list, tuple)) else [None if seed is None else seed + k for k in numbers]
        self.randoms = [np_random(own)[0] if own is not None or not r else r for own, r in zip(seeds, self.randoms)]
        self.begin(np.array(numbers))
        return self.task.observe(self.task.towels()), {}

    def begin(self, worlds):
        self.task.begin(worlds, [self.randoms[world] for world in worlds])
        self.over[worlds] = False

    def step(self, actions):
        fresh = np.flatnonzero(self.over)
        going = np.flatnonzero(~self.over)
        self.task.act(actions, going)
        self.worlds.step(STEPS)
        rewards, ended, truncated = np.zeros(self.num_envs), *np.zeros((2, self.num_envs), bool)
        rewards[going], truncated[going] = self.task.judge(self.task.towels(), going)
        frozen = np.intersect1d(np.array(self.worlds.frozen, int), going)
        rewards[frozen], ended[frozen], truncated[frozen] = -1.0, True, False
        if len(fresh):
            self.begin(fresh)
        self.over = ended | truncated
        return self.task.observe(self.task.towels()), rewards, ended, truncated, {}


def scripted(action: int):
    """A plan that needs no learning: close, then lift and turn."""
    return np.array([0, 0, 0, -1], np.float32) if action < 12 else np.array([-0.2, 1, 0.6, -1], np.float32)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--worlds", type=int, default=4)
    towels = LiftTowels(parser.parse_args().worlds)
    towels.reset(seed=1)
    total = np.zeros(towels.num_envs)
    for k in range(LENGTH):
        _, rewards, *_ = towels.step(np.tile(scripted(k), (towels.num_envs, 1)))
        total += rewards
    print("sum of rewards:", " ".join(f"{value:.4f}" for value in total))
    print(f"intersections: {sum(world.count_intersections() for world in towels.worlds)}")
