# SPDX-License-Identifier: Apache-2.0
"""The environment of examples/09_gymnasium.py: Gymnasium's own checks, seeds, worlds that equal one alone, a lift."""

import runpy
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def example():
    sys.path.insert(0, str(EXAMPLES))
    try:
        return runpy.run_path(str(EXAMPLES / "09_gymnasium.py"))
    finally:
        sys.path.remove(str(EXAMPLES))


def episode(env, seed, actions):
    """Observations and rewards of an episode."""
    found = [env.reset(seed=seed)[0]]
    rewards = []
    for action in actions:
        observation, reward, _, _, _ = env.step(action)
        found.append(observation)
        rewards.append(reward)
    return np.array(found), np.array(rewards)


def random_actions(number, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (number, 4)).astype(np.float32)


def test_gymnasium_finds_nothing_wrong(example):
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*infinity.*")  # heights have no bound
        warnings.filterwarnings("ignore", message=".*spec.*")  # it is not registered
        check_env(example["LiftTowel"](), skip_render_check=True)


def test_a_seed_gives_the_same_bits_and_another_others(example):
    env = example["LiftTowel"]()
    actions = random_actions(6)
    first, rewards = episode(env, 3, actions)
    again, same = episode(env, 3, actions)
    fresh, _ = episode(example["LiftTowel"](), 3, actions)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, fresh)
    np.testing.assert_array_equal(rewards, same)
    assert (env.reset(seed=4)[0] != first[0]).any()


def test_many_worlds_are_one_many_times(example):
    many = example["LiftTowels"](3)
    actions = np.stack([random_actions(5, k) for k in range(3)], axis=1)
    found, rewards = episode(many, 7, actions)
    assert many.observation_space.contains(found[-1])
    for k in range(3):
        alone, own = episode(example["LiftTowel"](), 7 + k, actions[:, k])
        np.testing.assert_array_equal(found[:, k], alone)
        np.testing.assert_array_equal(rewards[:, k], own)


def test_the_scripted_hand_lifts_the_towel_and_the_next_episode_begins(example):
    many = example["LiftTowels"](2)
    start = many.reset(seed=1)[0]
    total = np.zeros(2)
    for k in range(example["LENGTH"]):
        _, rewards, ended, truncated, _ = many.step(np.tile(example["scripted"](k), (2, 1)))
        total += rewards
        assert not ended.any() and truncated.all() == (k == example["LENGTH"] - 1)
    assert sum(world.count_intersections() for world in many.worlds) == 0
    # The hand ends 0.5 m above the table and carries it; the rewards are the heights that its mass was lifted by.
    heights = [world.masses @ world.positions[: len(world.masses), 2] / world.masses.sum() for world in many.worlds]
    assert (total > 1).all() and np.abs(total - (np.array(heights) - 0.00101) / 0.24).max() < 1e-9
    observation, rewards, _, truncated, _ = many.step(np.zeros((2, 4), np.float32))
    assert (rewards == 0).all() and not truncated.any()
    assert observation.shape == start.shape and (observation != start).any(), "the seed goes on"
    assert (np.abs(observation[:, 2:27:3] * 0.24 - 0.00101) < 1e-9).all(), "the towel lies flat again"
