# SPDX-License-Identifier: Apache-2.0
"""Damages a file: the same random numbers make the same damage."""

import re

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    b"nan",
    b"NaN",
    b"inf",
    b"-inf",
    b"1e308",
    b"-1e308",
    b"1e400",
    b"1e-308",
    b"0",
    b"-1",
    b"-0",
    b"2147483647",
    b"2147483648",
    b"-2147483649",
    b"4294967295",
    b"18446744073709551616",
    b"1000000000",
    b"0.5",
    b"1e9",
    b"1" * 400,
    b'"1"',
    b"null",
    b"[]",
    b"true",
)
DEEP = (b"[" * 100_000, b'{"a":' * 50_000, b"(" * 10_000, b"<a>" * 50_000)


def flip(random, data):
    for _ in range(random.choice((1, 1, 2, 8, 32))):
        place = random.randrange(len(data))
        data[place] = random.randrange(256) if random.random() < 0.5 else data[place] ^ 1 << random.randrange(8)
    return data


def truncate(random, data):
    return data[: random.randrange(len(data))]


def cut(random, data):
    first = random.randrange(len(data))
    return data[:first] + data[first + random.choice((1, 4, 64, 1000)) :]


def duplicate(random, data):
    first = random.randrange(len(data))
    block = data[first : first + random.choice((1, 8, 100, 2000))]
    place = random.randrange(len(data))
    return data[:place] + block * random.choice((1, 1, 2, 50)) + data[place:]


def number(random, data):
    """Puts a remarkable number in the place of one in the text."""
    for _ in range(random.choice((1, 1, 1, 3))):
        found = list(NUMBER.finditer(data))
        if not found:
            return insert(random, data)
        match = random.choice(found)
        data = data[: match.start()] + random.choice(NUMBERS) + data[match.end() :]
    return data


def insert(random, data):
    place = random.randrange(len(data))
    return data[:place] + random.choice(NUMBERS) + data[place:]


def word(random, data):
    """Puts a remarkable binary number of 4 or 8 bytes in."""
    value = random.choice((0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000, 0x7F800000, 0x3B9ACA00))
    size = random.choice((4, 8))
    place = random.randrange(len(data))
    data[place : place + size] = (value * 0x100000001 % 2 ** (8 * size)).to_bytes(size, "little")
    return data


def nest(random, data):
    place = random.randrange(len(data))
    return data[:place] + random.choice(DEEP) + data[place:]


def swap(random, data):
    """Exchanges two lines, or puts one in the place of another."""
    lines = data.split(b"\n")
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a] if random.random() < 0.5 else lines[b]
    return bytearray(b"\n".join(lines))


def value(random, data):
    """Exchanges two numbers of a text."""
    found = list(NUMBER.finditer(data))
    if len(found) < 2:
        return flip(random, data)
    first, second = sorted(random.sample(found, 2), key=lambda match: match.start())
    return data[: first.start()] + second[0] + data[first.end() : second.start()] + first[0] + data[second.end() :]


WAYS = (*[flip] * 3, *[number] * 4, *[word] * 2, truncate, cut, duplicate, insert, nest, swap, value)


def mutated(random, content):
    """Returns damaged bytes. random: a random.Random."""
    data = bytearray(content)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        if data:
            data = bytearray(random.choice(WAYS)(random, data))
    return bytes(data)
