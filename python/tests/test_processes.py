"""Forks, threads, interrupts, pickles."""

import contextlib
import copy
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import raystream as rs
from shapes import icosphere, rays

MESH = rs.Mesh(*icosphere(4))
RAYS = rays(60_000)
HASH = MESH.cast(RAYS).hash()
HAS_FORK = hasattr(os, "fork")


def ask(_):
    """The hash of an answer, in whatever process or thread this is."""
    return MESH.cast(RAYS, threads=2).hash()


class Processes(unittest.TestCase):
    @unittest.skipUnless(HAS_FORK, "this system does not fork")
    def test_forked_children_answer(self):
        with multiprocessing.get_context("fork").Pool(8) as pool:
            self.assertEqual(set(pool.map_async(ask, range(16)).get(timeout=60)), {HASH})

    @unittest.skipUnless(HAS_FORK, "this system does not fork")
    def test_children_forked_while_a_thread_is_in_a_call_answer(self):
        going = threading.Event()

        def work():
            while not going.is_set():
                ask(None)

        threads = [threading.Thread(target=work) for _ in range(3)]
        for thread in threads:
            thread.start()
        try:
            for _ in range(10):
                child = os.fork()
                if child == 0:
                    os._exit(0 if ask(None) == HASH else 1)
                self.assertEqual(self.ended(child), 0)
        finally:
            going.set()
            for thread in threads:
                thread.join()

    def ended(self, child):
        """The exit code of a child, which has a minute."""
        for _ in range(6000):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.01)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return "the child hangs"

    @unittest.skipUnless(HAS_FORK, "this system does not fork")
    def test_grandchildren_answer(self):
        child = os.fork()
        if child == 0:
            ask(None)
            grandchild = os.fork()
            if grandchild == 0:
                os._exit(0 if ask(None) == HASH else 1)
            os._exit(os.waitstatus_to_exitcode(os.waitpid(grandchild, 0)[1]))
        self.assertEqual(self.ended(child), 0)

    def test_spawned_children_get_pickles(self):
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            self.assertEqual(pool.apply_async(hash_of, (MESH, RAYS)).get(timeout=60), HASH)

    def test_many_threads_answer(self):
        with ThreadPoolExecutor(32) as pool:
            self.assertEqual(set(pool.map(ask, range(64))), {HASH})

    def test_the_lock_is_released(self):
        turns, done = 0, threading.Event()

        def work():
            for _ in range(5):
                MESH.nearest(RAYS[:30_000, :3], threads=1)
            done.set()

        thread = threading.Thread(target=work)
        thread.start()
        while not done.is_set():
            turns += 1
            time.sleep(0.001)
        thread.join()
        self.assertGreater(turns, 10)


def hash_of(mesh, question):
    """The hash of an answer of a mesh that came by pickle."""
    return mesh.cast(question).hash()


# A shell's jobs in the background ignore interrupts, and so do their children unless they say otherwise.
LONG = """
import signal, sys, time, numpy as np, raystream as rs
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, sys.argv[1])
from shapes import icosphere
mesh = rs.Mesh(*icosphere(5))
points = np.random.default_rng(0).normal(size=(20_000_000, 3)).astype(np.float32)
print("ready", flush=True)
begun = time.monotonic()
try:
    mesh.nearest(points, threads=1)
    print("finished")
except KeyboardInterrupt:
    print("interrupted")
hits = mesh.cast(points[:10], points[10:20])
"""


class Interrupts(unittest.TestCase):
    def test_a_long_call_is_interrupted(self):
        command = [sys.executable, "-c", LONG, os.path.dirname(os.path.abspath(__file__))]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        with process, contextlib.ExitStack() as at_end:
            # Whatever fails: leaving the process waits for its end.
            at_end.callback(process.kill)
            self.assertEqual(process.stdout.readline(), "ready\n")
            time.sleep(0.5)
            begun = time.monotonic()
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.communicate(timeout=60)[0], "interrupted\n")
            self.assertLess(time.monotonic() - begun, 5)
            self.assertEqual(process.returncode, 0)


class Copies(unittest.TestCase):
    def test_meshes_pickle_and_copy(self):
        for kind in (np.float32, np.float64):
            vertices, faces = icosphere(1)
            normals = vertices.copy()
            mesh = rs.Mesh(vertices.astype(kind), faces, np.arange(len(faces)), normals=normals)
            want = "t primitive attribute shading_normal"
            expected = mesh.cast(RAYS[:500], want=want).hash()
            for other in (pickle.loads(pickle.dumps(mesh)), copy.copy(mesh), copy.deepcopy(mesh)):
                self.assertEqual(other.cast(RAYS[:500], want=want).hash(), expected)
                self.assertEqual(other.vertices.dtype, kind)
            copied = copy.copy(mesh)
            copied.refit(vertices.astype(kind) * 2)
            self.assertEqual(mesh.cast(RAYS[:500], want=want).hash(), expected)

    def test_answers_pickle(self):
        hits = MESH.cast(RAYS[:100])
        self.assertEqual(pickle.loads(pickle.dumps(hits)).hash(), hits.hash())


if __name__ == "__main__":
    unittest.main()
