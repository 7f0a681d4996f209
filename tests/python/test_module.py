"""Clouds, paths, renderers, truths and comparisons from Python."""

import gc
import math
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import unittest
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np

import palpate

SINUSOID = "sinusoid:points=10201"
ABOVE = (0.0, 0.0, 60.0)


class Ball:
    """A ball of 20 mm around the origin, felt as a spring."""

    def prepare(self, scene):
        self.stiffness = scene.clouds[0].stiffness_n_per_mm

    def step(self, hip, t_s):
        distance = math.sqrt(sum(x * x for x in hip))
        if distance >= 20.0:
            return None
        return [self.stiffness * x * (20.0 - distance) / distance for x in hip]


def sphere():
    return palpate.generate("sphere", points=4000, extent_mm=40)


class Clouds(unittest.TestCase):
    def test_an_array_becomes_the_points_it_holds(self):
        given = np.random.default_rng(1).uniform(-30, 30, (1000, 3)) + [1000.0, 0.0, 0.0]
        cloud = palpate.cloud(given / 1000.0, unit="m")
        self.assertEqual(len(cloud), 1000)
        self.assertTrue(cloud.copied)
        np.testing.assert_allclose(cloud.points(), given, atol=2e-6)
        self.assertAlmostEqual(cloud.origin_mm[0], 1000.0, delta=30)
        self.assertFalse(cloud.x.flags.writeable)
        with self.assertRaises(ValueError):
            cloud.x[0] = 1.0

    def test_a_million_points_stay_where_they_are(self):
        columns = palpate.Columns(1_000_000)
        side = np.linspace(-50, 50, 1000, dtype=np.float32)
        columns.x[:] = np.tile(side, 1000)
        columns.y[:] = np.repeat(side, 1000)
        columns.z[:] = np.cos(columns.x / 8)
        before = [a.ctypes.data for a in (columns.x, columns.y, columns.z)]
        cloud = columns.cloud()
        after = [a.ctypes.data for a in (cloud.x, cloud.y, cloud.z)]
        print("a million points at", [hex(p) for p in before], "and as a cloud at", [hex(p) for p in after])
        self.assertEqual(before, after)
        self.assertFalse(cloud.copied)
        self.assertFalse(columns.x.flags.writeable)
        with self.assertRaisesRegex(palpate.Error, "already"):
            columns.cloud()
        del columns
        gc.collect()
        self.assertEqual(cloud.x[0], -50.0)

    def test_columns_that_change_are_noticed(self):
        columns = palpate.Columns(9)
        view = columns.x[:]
        columns.x[:], columns.y[:] = np.tile([0, 1, 2], 3), np.repeat([0, 1, 2], 3)
        columns.z[:] = 0
        cloud = columns.cloud()
        view[0] = np.nan
        with self.assertRaisesRegex(palpate.Error, "changed"):
            palpate.renderer("cloud", cloud)

    def test_what_is_no_cloud_is_told(self):
        far = palpate.Columns(3)
        far.x[:] = [1e6, 1e6 + 1, 1e6]
        far.y[:], far.z[:] = [0, 0, 1], 0
        with self.assertRaisesRegex(palpate.Error, "far from their origin"):
            far.cloud()
        for wrong in (np.zeros((3, 2)), np.zeros(3), np.zeros((0, 3)), 7, "abc", None, [[1, 2], [3]], {"x": 1}):
            with self.assertRaises(palpate.Error) as told:
                palpate.cloud(wrong)
            self.assertIn("(n, 3)", told.exception.remedy)
        holes = np.zeros((4, 3))
        holes[2] = np.nan
        with self.assertRaisesRegex(palpate.Error, "1 of 4 points are not finite"):
            palpate.cloud(holes)
        with self.assertRaisesRegex(palpate.Error, "unit"):
            palpate.cloud(np.zeros((4, 3)), unit="furlong")

    def test_errors_of_files_have_file_line_and_remedy(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "bad.csv")
            with open(file, "w") as out:
                out.write("t_s,x_mm,y_mm,z_mm\n0,0,0,60\n0.001,zero,0,60\n")
            with self.assertRaises(palpate.Error) as told:
                palpate.path(file)
        self.assertEqual((told.exception.file, told.exception.line), (file, 3))
        self.assertNotEqual(told.exception.remedy, "")

    def test_a_prepared_file_is_read_again(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "ball.palsurf")
            sphere().prepare(file)
            again = palpate.read(file)
            frame = palpate.renderer("cloud-smooth", again).step((0.0, 0.0, 30.0))
            self.assertFalse(frame.contact)
            with self.assertRaisesRegex(palpate.Error, "prepared file already"):
                again.prepare(os.path.join(folder, "twice.palsurf"))


class Renderers(unittest.TestCase):
    def test_a_step_is_what_a_replay_answers(self):
        cloud = sphere()
        renderer = palpate.renderer("cloud", cloud, stiffness=0.4)
        hips = np.zeros((300, 3))
        hips[:, 2] = np.linspace(30, 18, 300)
        trace = renderer.replay(hips)
        renderer.restart(hips[0], -1e-3)
        frames = [renderer.step(hip) for hip in hips]
        np.testing.assert_array_equal(trace.force_n, [frame.force for frame in frames])
        np.testing.assert_array_equal(trace.god_object_mm, [frame.god_object for frame in frames])
        np.testing.assert_array_equal(trace.contact, [frame.contact for frame in frames])
        self.assertEqual(trace.hash, renderer.replay(palpate.path(hips)).hash)
        self.assertAlmostEqual(frames[-1].force[2], 0.4 * 2.0, delta=0.05)
        self.assertEqual((frames[0].model, frames[-1].model, frames[-1].status), (-1, 0, "ok"))

    def test_places_of_every_kind(self):
        renderer = palpate.renderer("cloud", sphere())
        answers = set()
        for place in ((0, 0, 18.0), [0.0, 0, 18], np.array([0, 0, 18.0]), np.array([0, 0, 18], np.float32),
                      np.array([[0, 9], [0, 9], [18.0, 9]])[:, 0], (0, 0, np.float64(18))):
            renderer.restart((0, 0, 30))
            answers.add(renderer.step(place).force)
        self.assertEqual(len(answers), 1)
        for wrong in ((0, 0), "abc", None, 7, (0, 0, "x"), [[1, 2, 3]], np.zeros((3, 2)), {}, object()):
            with self.assertRaisesRegex(palpate.Error, "three numbers"):
                renderer.step(wrong)
        self.assertEqual(renderer.step((0, math.nan, 0)).status, "non-finite")

    def test_time_goes_on(self):
        renderer = palpate.renderer("cloud", sphere())
        renderer.step(ABOVE, 1.0)
        with self.assertRaisesRegex(palpate.Error, "increase"):
            renderer.step(ABOVE, 1.0)
        renderer.step(ABOVE)
        with self.assertRaises(palpate.Error):
            renderer.step(ABOVE, math.nan)

    def test_unknown_names_and_options(self):
        with self.assertRaisesRegex(palpate.Error, "cloud"):
            palpate.renderer("cluod", sphere())
        for wrong in ({"refine": "maybe"}, {"shadow": 1}, {"stiffness": -1}, {"friction": (0.5, 0.7)}, {"refine": []}):
            with self.assertRaises(palpate.Error):
                palpate.renderer("cloud", sphere(), **wrong)
        with self.assertRaisesRegex(palpate.Error, "^stiffness: 'hard'"):
            palpate.renderer("cloud", sphere(), stiffness="hard")
        with self.assertRaisesRegex(palpate.Error, "mean 'stanford-bunny'"):
            palpate.read("bunny")
        self.assertIn("cloud-smooth", palpate.renderers())

    def test_a_closed_renderer_answers_no_more(self):
        with palpate.renderer("cloud", sphere()) as renderer:
            renderer.step(ABOVE)
        self.assertTrue(renderer.closed)
        renderer.close()
        for use in (lambda: renderer.step(ABOVE), lambda: renderer.replay([ABOVE]), lambda: renderer.restart(ABOVE)):
            with self.assertRaisesRegex(palpate.Error, "closed"):
                use()

    def test_arrays_outlive_what_they_came_from(self):
        renderer = palpate.renderer("cloud", sphere())
        force = renderer.replay(np.tile(ABOVE, (1000, 1))).force_n
        renderer.close()
        del renderer
        gc.collect()
        self.assertEqual(force.shape, (1000, 3))
        self.assertFalse(force.any())

    def test_threads_run_beside_a_replay_and_share_no_renderer(self):
        hips = np.tile(ABOVE, (200_000, 1))
        hips[:, 2] -= np.linspace(0, 45, len(hips))
        renderer = palpate.renderer("cloud", sphere())
        alone = renderer.replay(hips).hash
        answers, refused, going = [], [], threading.Event()

        def replay():
            going.set()
            answers.append(renderer.replay(hips).hash)

        thread = threading.Thread(target=replay)
        thread.start()
        going.wait()
        while thread.is_alive():
            try:
                renderer.counters()
            except palpate.Error as error:
                refused.append(error.what)
        thread.join()
        self.assertEqual(answers, [alone])
        self.assertTrue(all("another caller" in what for what in refused))
        self.assertGreater(len(refused), 0, "no other thread ran during the replay")


    def test_an_interpreter_ends_while_threads_are_at_work(self):
        script = ("import threading, time, numpy, palpate\n"
                  "renderer = palpate.renderer('cloud', 'sphere:points=500')\n"
                  "hips = numpy.tile((0, 0, 200.0), (100000, 1))\n"
                  "def work():\n    while True: renderer.replay(hips)\n"
                  "threading.Thread(target=work, daemon=True).start()\ntime.sleep(0.1)\n")
        for _ in range(3):
            ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
            self.assertEqual(ended.returncode, 0, ended.stderr)


class Files(unittest.TestCase):
    FOLDER = os.path.join(os.environ.get("PALPATE_SOURCE", os.path.join(os.path.dirname(__file__), "..", "..")), "tests",
                          "corpus", "io", "recording")

    def test_a_recording_is_a_path_and_a_trace(self):
        path, trace = palpate.read_recording(os.path.join(self.FOLDER, "whole.palrec"))
        self.assertEqual((len(path), len(trace), int(trace.contact.sum())), (12, 12, 6))
        self.assertTrue((np.diff(path.t_s) > 0).all())

    def test_a_damaged_recording_is_told(self):
        file = os.path.join(self.FOLDER, "damaged.palrec")
        with self.assertRaisesRegex(palpate.Error, "damaged") as told:
            palpate.read_recording(file)
        self.assertEqual(told.exception.file, file)
        self.assertLess(len(palpate.read_recording(file, skip_damaged=True)[0]), 12)

    def test_a_scene_of_two_models(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "two.toml")
            with open(file, "w") as out:
                out.write('[[model]]\ngenerate = "sphere"\npoints = 2000\nextent_mm = 40\n[[model]]\n'
                          'generate = "plane"\npoints = 900\nposition_mm = [0, 0, -100]\n[control]\nforce_limit_n = 3.3\n')
            scene = palpate.scene(file)
            with self.assertRaisesRegex(palpate.Error, "2 models"):
                palpate.read(file)
        self.assertEqual([cloud.name for cloud in scene.clouds], ["sphere", "plane"])
        self.assertEqual(scene.force_limit_n, 3.3)
        renderer = palpate.renderer("cloud", scene)
        renderer.step((0, 0, -50))
        self.assertEqual(renderer.step((0, 0, -101)).model, 1)
        with self.assertRaisesRegex(palpate.Error, "no truth"):
            palpate.truth(np.tile(ABOVE, (9, 1)), scene)
        alone = palpate.renderer("cloud", scene.clouds[1])
        alone.step((0, 0, -50))
        self.assertEqual(alone.step((0, 0, -101)).model, 0)


class Comparisons(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.cloud = palpate.read(SINUSOID)
        cls.path = palpate.path("weave:frames=2000", cls.cloud)

    def test_scores_are_those_of_compare(self):
        renderer = palpate.renderer("cloud", self.cloud)
        trace = renderer.replay(self.path)
        truth = palpate.truth(self.path)
        scores = palpate.score(trace, truth)
        compared = palpate.compare([renderer, "cloud-smooth"], self.path, passes=1)
        self.assertEqual([row["label"] for row in compared.rows], ["cloud", "cloud-smooth"])
        row = compared.rows[0]
        self.assertEqual(row["status"], "ok")
        self.assertEqual(row["trace_hash"], trace.hash)
        self.assertEqual(row["accuracy.force_rms_n"], scores["accuracy"]["force_rms_n"])
        # The score's own definition, from the arrays.
        touched = truth.contact | trace.contact
        error = np.sum((trace.force_n - truth.force_n)[touched] ** 2) / np.count_nonzero(truth.contact)
        self.assertAlmostEqual(scores["accuracy"]["force_rms_n"], math.sqrt(error), places=9)

    def test_a_table_and_a_picture(self):
        import matplotlib

        matplotlib.use("Agg")
        compared = palpate.compare(["cloud", "cloud:refine=1:label=bare"], self.path, passes=1)
        table = compared.table()
        self.assertEqual(list(table["label"]), ["cloud", "bare"])
        axes = compared.plot()
        self.assertEqual(len(axes.lines), 2)
        self.assertEqual(axes.get_xlabel(), "frame all mean, µs")
        self.assertRegex(compared._repr_html_(), r"<th>memory\.<wbr>bytes</th>")
        with self.assertRaisesRegex(palpate.Error, "'memory.byte'; did you mean 'memory.bytes'"):
            compared.plot(x="memory.byte")
        unscored = palpate.Comparison({"renderers": [{"label": "cloud", "frame_all": {"mean_us": 1.0}, "accuracy": None}]},
                                      self.path, {})
        self.assertEqual(len(unscored.plot().lines), 0)
        with self.assertRaisesRegex(palpate.Error, "Trace and a Truth"):
            palpate.score(self.path, palpate.truth(self.path))
        self.assertEqual(list(palpate.compare("cloud", self.path, passes=1).traces), ["cloud"])

    def test_a_renderer_written_in_python_is_compared(self):
        ball = sphere()
        path = palpate.path("weave:frames=1000", ball)
        compared = palpate.compare([Ball, "cloud"], path, passes=1)
        rows = {row["label"]: row for row in compared.rows}
        self.assertEqual(rows["Ball"]["status"], "ok")
        # The sphere's own formula: exact.
        self.assertLess(rows["Ball"]["accuracy.force_rms_percent"], 1e-6)
        self.assertLess(rows["Ball"]["accuracy.force_rms_percent"], rows["cloud"]["accuracy.force_rms_percent"])
        own = palpate.renderer(Ball, ball).replay(path)
        self.assertEqual(own.hash, compared.traces["Ball"].hash)

    def test_an_executor_runs_each_renderer(self):
        for source in (sphere(), palpate.cloud(sphere().points())):
            path = palpate.path(source.points()[:1] * np.linspace(1.2, 0.9, 500)[:, None], source)
            here = palpate.compare(["cloud", "penalty-grid"], path, passes=1)
            with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as processes:
                there = palpate.compare(["cloud", "penalty-grid"], path, passes=1, executor=processes)
            for label, trace in here.traces.items():
                self.assertTrue(trace.contact.any())
                self.assertEqual(trace.hash, there.traces[label].hash)
        with ThreadPoolExecutor(2) as threads:
            twice = palpate.compare([Ball, "cloud", "cloud"], path, passes=1, executor=threads)
        self.assertEqual([row["label"] for row in twice.rows], ["Ball", "cloud", "cloud-2"])

    def test_what_is_pickled_is_the_same(self):
        path = palpate.path("weave:frames=200", sphere())
        trace = pickle.loads(pickle.dumps(palpate.renderer("cloud", sphere()).replay(path)))
        self.assertEqual((trace.label, trace.model.min(), len(trace)), ("cloud", -1, 200))
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(path)).t_s, path.t_s)
        with self.assertRaisesRegex(palpate.Error, "length"):
            palpate.Path.__new__(palpate.Path).__setstate__(("", np.zeros(2), np.zeros((3, 3))))
        soft = palpate.renderer("cloud", sphere(), stiffness=0.1)
        self.assertEqual(pickle.loads(pickle.dumps(sphere())).stiffness_n_per_mm, sphere().stiffness_n_per_mm)
        with self.assertRaisesRegex(palpate.Error, "surface was changed"):
            pickle.dumps(soft.scene)

    def test_an_exception_in_python_fails_its_row_alone(self):
        class Late:
            steps = 0

            def prepare(self, scene):
                pass

            def step(self, hip, t_s):
                Late.steps += 1
                if Late.steps == 700:
                    raise ZeroDivisionError("on purpose")

        class Never(Late):
            def prepare(self, scene):
                raise palpate.Error("no licence", "buy one")

        class Wrong(Late):
            def step(self, hip, t_s):
                return "up"

        compared = palpate.compare([Late, "cloud", Never, Wrong], self.path, passes=1)
        rows = {row["label"]: row for row in compared.rows}
        self.assertEqual([rows[name]["status"] for name in ("Late", "cloud", "Never", "Wrong")],
                         ["failed", "ok", "failed", "failed"])
        self.assertIn("on purpose", rows["Late"]["reason"])
        self.assertIn("no licence", rows["Never"]["reason"])
        self.assertEqual(list(compared.traces), ["cloud"])
        with self.assertRaises(palpate.Error) as told:
            Late.steps = 699
            palpate.renderer(Late, self.cloud).step(ABOVE)
        self.assertEqual(told.exception.file, __file__)
        with self.assertRaisesRegex(palpate.Error, "no method 'step'"):
            palpate.renderer(type("Half", (), {"prepare": print}), self.cloud)
        with self.assertRaisesRegex(palpate.Error, "taken"):
            palpate.renderer(type("cloud", (Late,), {}), self.cloud)

    def test_a_renderer_that_uses_itself_is_refused(self):
        held = []

        class Inward:
            def prepare(self, scene):
                pass

            def step(self, hip, t_s):
                held[0].close()

        held.append(palpate.renderer(Inward, self.cloud))
        with self.assertRaisesRegex(palpate.Error, "another caller"):
            held[0].step(ABOVE)

    def test_a_path_needs_its_scene(self):
        bare = palpate.path(np.tile(ABOVE, (9, 1)))
        for use in (lambda: palpate.truth(bare), lambda: palpate.compare(["cloud"], bare),
                    lambda: palpate.path("weave")):
            with self.assertRaisesRegex(palpate.Error, "scene"):
                use()
        broken = np.tile(ABOVE, (9, 1))
        broken[4] = np.inf
        with self.assertRaisesRegex(palpate.Error, "sample 4"):
            palpate.truth(broken, self.cloud)

    def test_traces_are_written_and_read(self):
        trace = palpate.renderer("cloud", self.cloud).replay(self.path)
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "trace.csv")
            trace.write(self.path, file)
            path, again = palpate.read_trace(file)
        self.assertEqual(again.hash, trace.hash)
        np.testing.assert_array_equal(path.hip_mm, self.path.hip_mm)


if __name__ == "__main__":
    unittest.main()
