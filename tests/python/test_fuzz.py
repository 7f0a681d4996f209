"""Random calls with random arguments: every one answers or raises an exception."""

import math
import os
import random
import subprocess
import sys
import unittest

CALLS = int(os.environ.get("PALPATE_FUZZ_CALLS", "4000"))
SEEDS = (1, 2, 3)


def run(seed: int) -> None:
    import numpy as np

    import palpate

    luck = random.Random(seed)

    class Fickle:
        def prepare(self, scene):
            if luck.random() < 0.2:
                raise RuntimeError("prepare")

        def step(self, hip, t_s):
            chance = luck.random()
            if chance < 0.1:
                raise KeyError("step")
            return luck.choice([None, (0, 0, 1), ((0, 0, 1), hip), "no", (1, 2), [math.nan] * 3, np.ones(3), {}])

    class Hostile(list):
        """Changes while it is read."""

        def __getitem__(self, at):
            self.clear()
            return luck.choice([1.0, "x", None])

        def __len__(self):
            return 3

    small = ["sphere:points=500", "plane:points=400", "torus:points=500"]
    clouds = [palpate.read(name) for name in small]
    names = [name for name in palpate.renderers() if "mesh" not in name]
    held = list(clouds) + [palpate.path("weave:frames=50", clouds[0])]

    def number():
        return luck.choice([0, 1, -1, 3, 1e-3, 20.0, 1e300, -1e300, math.nan, math.inf, 2**70, True, None, "7", "x"])

    def place():
        return luck.choice([(0, 0, 30), [0.0, 1.0, 19.0], (number(), number(), number()), np.zeros(luck.randrange(5)),
                            Hostile([1, 2, 3]), "abc", None, b"123", np.array([1 + 2j, 0, 0])])

    def array():
        shape = luck.choice([(5, 3), (0, 3), (3, 2), (3,), (4, 3, 1), (1, 3)])
        values = np.random.default_rng(seed).normal(size=shape) * luck.choice([1, 30, 1e30])
        if values.size and luck.random() < 0.2:
            values.flat[0] = luck.choice([math.nan, math.inf])
        return luck.choice([values, values.astype(np.float32), np.asfortranarray(values), values[::-1], values.tolist(),
                            values.astype(object), values.T])

    def anything():
        return luck.choice([number, place, array, lambda: luck.choice(held), lambda: luck.choice(names + small),
                            lambda: Fickle, Fickle, lambda: type])()

    def method(thing):
        public = [name for name in dir(thing) if not name.startswith("__") and name not in ("write", "prepare")]
        name = luck.choice(public)
        attribute = getattr(thing, name)
        return attribute(*[anything() for _ in range(luck.randrange(3))]) if callable(attribute) else attribute

    def call():
        what = luck.randrange(12)
        if what == 0:
            return palpate.cloud(array(), unit=luck.choice(["mm", "m", "x"]), drop_non_finite=luck.random() < 0.5)
        if what == 1:
            return palpate.renderer(luck.choice(names + [Fickle, anything()]), luck.choice(clouds + [anything()]),
                                    **luck.choice([{}, {"stiffness": number()}, {"refine": number()}, {"x": number()}]))
        if what == 2:
            return palpate.path(luck.choice([array(), anything(), "raster:frames=20"]), luck.choice(clouds + [None]))
        if what == 3:
            return palpate.truth(anything(), luck.choice(held))
        if what == 4 and luck.random() < 0.2:
            return palpate.compare([luck.choice(names), Fickle], luck.choice([array(), held[3]]), passes=1,
                                   scene=luck.choice(clouds), budget_s=0.01)
        if what == 5:
            return palpate.score(anything(), anything())
        if what == 6:
            columns = palpate.Columns(luck.choice([number(), 9, 9, 9]))
            columns.x[:] = luck.choice([0, 1, math.nan])
            return columns.cloud(place()) if luck.random() < 0.5 else columns
        return method(luck.choice(held))

    answered = 0
    for _ in range(CALLS):
        try:
            answer = call()
            answered += 1
            if type(answer).__module__.startswith("palpate"):
                held.append(answer)
        except (palpate.Error, TypeError, ValueError, KeyError, RuntimeError, AttributeError, IndexError, OverflowError,
                MemoryError, AssertionError, BufferError):
            pass
        if len(held) > 60:
            del held[luck.randrange(4, len(held))]
    print(f"seed {seed}: {answered} of {CALLS} calls answered")
    if answered < CALLS // 20:
        sys.exit("too few calls answered: this tests nothing")


class Fuzz(unittest.TestCase):
    def test_no_call_ends_the_interpreter(self):
        for seed in SEEDS:
            ended = subprocess.run([sys.executable, "-X", "faulthandler", __file__, str(seed)], capture_output=True,
                                   text=True, timeout=600)
            self.assertEqual(ended.returncode, 0, ended.stdout[-500:] + ended.stderr[-3000:])
            print(ended.stdout.strip())


if __name__ == "__main__":
    if len(sys.argv) == 2 and sys.argv[1].isdigit():
        run(int(sys.argv[1]))
    else:
        unittest.main()
