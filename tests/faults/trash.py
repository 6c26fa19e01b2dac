"""Trashed copies of a file."""

import random


def trashed(data: bytes, seed: int) -> bytes:
    """Some bytes flipped, overwritten with the ends of an integer, doubled or lost."""
    chance = random.Random(seed)
    out = bytearray(data)
    for _ in range(chance.choice([1, 3, 20])):
        at = chance.randrange(len(out))
        change = chance.randrange(5)
        if change == 0:
            out[at] ^= 1 << chance.randrange(8)
        elif change == 1:
            out[at] = chance.randrange(256)
        elif change == 2:
            ends = [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x7f\xff\xff\xff", bytes(4)]
            out[at : at + 4] = chance.choice(ends)
        elif change == 3:
            out[at:at] = out[at : at + chance.randrange(1, 64)]
        else:
            del out[at : at + chance.randrange(1, 64)]
    return bytes(out)
