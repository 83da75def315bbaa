# SPDX-License-Identifier: Apache-2.0
"""Lifting a towel as an environment of Gymnasium, alone and many at once: `python examples/09_gymnasium.py`.

An action moves the hand of `gripper.py` along x and z, turns it, and opens or closes it, for a fifteenth of a second.
The reward of a step is by how much it lifted the towel, in towel lengths. An episode ends after 60 actions.
"""

import argparse

import gymnasium
import numpy as np
from gripper import CENTRE, OPEN, PRESS, SIDE, THICKNESS, Hand, towel_scene
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
    """What hand and towel of one world do and how they are seen and judged."""

    def __init__(self, simulation: cama.Simulation) -> None:
        self.simulation = simulation
        self.reset(np.random.default_rng(0))

    def reset(self, random: np.random.Generator) -> None:
        """Begins an episode: the towel hangs over the edge by 3 to 4 cm, and the hand is up to 5 mm from its place."""
        n = self.simulation.cloth_vertex_count
        towel = self.simulation.scene.cloths[0].vertices
        self.simulation.set_state(towel - [random.uniform(0, 0.01), 0, 0], np.zeros((n, 3)))
        self.hand = Hand(self.simulation)
        self.hand.position = CENTRE + [random.uniform(-0.005, 0), 0, random.uniform(-0.003, 0.003)]
        self.actions, self.height = 0, self.mean_height()

    def mean_height(self) -> float:
        """m, of the towel above the table."""
        return float(self.simulation.masses @ self.towel()[:, 2] / self.simulation.masses.sum())

    def towel(self):
        """Positions [vertices, 3], m."""
        return self.simulation.positions[: self.simulation.cloth_vertex_count]

    def act(self, action) -> None:
        """Gives the pads their targets: x, z, angle and gap."""
        action = np.clip(np.asarray(action, np.float64), -1, 1)
        x, z, turn = action[:3] * REACH
        hand = self.hand
        hand.position = np.clip(hand.position + [x, 0, z], CENTRE - [0.1, 0, 0.005], CENTRE + [0.05, 0, 0.5])
        hand.angle = float(np.clip(hand.angle + turn, 0, np.pi / 2))
        hand.gap = float(np.clip(hand.gap + 0.006 * action[3], 1.7 * THICKNESS, OPEN))
        hand.move(STEPS / RATE)

    def judge(self) -> tuple[float, bool]:
        """Reward of the last action, and whether the episode is over."""
        self.actions += 1
        before, self.height = self.height, self.mean_height()
        return (self.height - before) / SIDE, self.actions == LENGTH

    def observe(self):
        """Points of the towel, the hand's x, z, angle and gap, and the force of its pads, about 1 in size."""
        hand = self.hand
        own = [(hand.position - CENTRE)[0] / SIDE, (hand.position - CENTRE)[2] / SIDE, hand.angle, hand.gap / OPEN]
        return np.concatenate([self.towel()[OBSERVED].ravel() / SIDE, own, [hand.pressing() / PRESS]])


class LiftTowel(gymnasium.Env):
    """One towel."""

    metadata = {"render_modes": []}
    observation_space, action_space = OBSERVATION, ACTION

    def __init__(self) -> None:
        self.simulation = cama.Worlds(towel_scene(cells=15), 1, **OPTIONS)
        self.task = Task(self.simulation[0])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.simulation.reset()
        self.task.reset(self.np_random)
        return self.task.observe(), {}

    def step(self, action):
        self.task.act(action)
        self.simulation.step(STEPS)
        if self.simulation.frozen:  # what is asked of the cloth cannot be computed
            return self.task.observe(), -1.0, True, False, {"error": str(self.simulation.error(0))}
        reward, over = self.task.judge()
        return self.task.observe(), reward, False, over, {}


class LiftTowels(gymnasium.vector.VectorEnv):
    """Many towels that advance together; every one has the bits of a LiftTowel with its seed.

    An episode that is over begins anew with the next step, whose action is not used (gymnasium's AutoresetMode
    NEXT_STEP).
    """

    metadata = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

    def __init__(self, number: int) -> None:
        self.num_envs, self.numbers = number, range(number)
        self.single_observation_space, self.single_action_space = OBSERVATION, ACTION
        self.observation_space = batch_space(OBSERVATION, number)
        self.action_space = batch_space(ACTION, number)
        self.worlds = cama.Worlds(towel_scene(cells=15), number, **OPTIONS)
        self.tasks = [Task(world) for world in self.worlds]
        self.over = np.zeros(number, bool)
        self.randoms = [None] * number

    def reset(self, *, seed=None, options=None):
        """Begins all episodes. World k has the seed of a LiftTowel with seed + k; or give a list of seeds."""
        seeds = seed if isinstance(seed, (list, tuple)) else [None if seed is None else seed + k for k in self.numbers]
        self.randoms = [np_random(own)[0] if own is not None or not r else r for own, r in zip(seeds, self.randoms)]
        self.begin(self.numbers)
        return self.observe(), {}

    def begin(self, worlds):
        """Begins episodes of worlds."""
        self.worlds.reset(list(worlds))
        for world in worlds:
            self.tasks[world].reset(self.randoms[world])
        self.over[list(worlds)] = False

    def observe(self):
        return np.stack([task.observe() for task in self.tasks])

    def step(self, actions):
        fresh = np.flatnonzero(self.over)
        going = np.flatnonzero(~self.over)
        for world in going:
            self.tasks[world].act(actions[world])
        self.worlds.step(STEPS)
        rewards, ended, truncated = np.zeros(self.num_envs), *np.zeros((2, self.num_envs), bool)
        for world in going:
            rewards[world], truncated[world] = self.tasks[world].judge()
        frozen = np.intersect1d(np.array(self.worlds.frozen, int), going)
        rewards[frozen], ended[frozen], truncated[frozen] = -1.0, True, False
        if len(fresh):
            self.begin(fresh)
        self.over = ended | truncated
        return self.observe(), rewards, ended, truncated, {}


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
