"""A live view that other processes help with, in a browser."""

import hashlib
import re
import subprocess

import service


class Workers(service.Case):
    OPTIONS = ("--spawn-nats",)

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        nats, keys = re.search(r"--nats (\S+) --nats-key (\S+)", (cls.folder / "log").read_text()).groups()
        command = [service.PROGRAM, "worker", "--nats", nats, "--nats-key", keys, "--name", "helper", "--threads", "1"]
        command += ["--tracer", "cpu"]
        command += ["--cache", cls.folder / "cache"]
        log = cls.enterClassContext(open(cls.folder / "worker.log", "wb"))
        cls.worker = subprocess.Popen(list(map(str, command)), stdout=log, stderr=log)
        cls.addClassCleanup(cls.worker.wait)
        cls.addClassCleanup(cls.worker.kill)

    def live_of_upload(self):
        """A live view of the scene from the store: workers fetch uploaded scenes alone."""
        page = self.page()
        # It has exchanged its token for a session by then.
        self.wait_for(page, "raystream.frames > 0")
        content = self.service.scene.read_text()
        scene = hashlib.sha256(content.encode()).hexdigest()
        status, told = page.evaluate("""async ([scene, body]) => {
            const answer = await fetch(`api/v1/scenes/${scene}`, { method: "PUT",
                headers: { "Content-Type": "application/json" }, body });
            return [answer.status, await answer.text()];
        }""", [scene, content])
        self.assertLess(status, 300, told)
        page.evaluate("scene => { location.hash = `live=${scene}`; }", scene)
        page.get_by_test_id("scene-name").get_by_text(scene[:8]).wait_for()
        self.wait_for(page, "raystream.frames > 0 && !raystream.moving")
        return page

    def orbit_until(self, page, row, holds):
        """Turns the camera until the row of the panel is as it should be; its cells."""
        for turn in range(40):
            self.drag(page, 40 if turn % 2 else -40, 0)
            cells = row.get_by_role("cell").all_inner_texts() if row.count() else []
            if cells and holds(cells):
                return cells
        log = (self.folder / "worker.log").read_text()
        self.fail(f"the row is {cells} after {turn + 1} turns; the worker's log:\n{log}")

    def test_the_panel_shows_who_renders_and_a_lost_worker_stops_no_picture(self):
        page = self.live_of_upload()
        row = page.get_by_test_id("workers").get_by_role("row").filter(has_text="helper")
        # On a loaded machine the worker may be late at first.
        name, rows, ms, tiles, _ = self.orbit_until(
            page, row, lambda cells: int(cells[1]) > 0 and row.get_attribute("data-state") == "ready")
        self.assertEqual(name, "helper")
        self.assertLessEqual(int(rows), page.evaluate("document.getElementById('picture').height"))
        self.assertGreater(float(ms), 0)
        self.assertNotEqual(tiles, "0")
        self.worker.kill()
        before = self.pixels(page)
        self.orbit_until(page, row, lambda cells: row.get_attribute("data-state") != "ready")
        self.wait_for(page, "!raystream.moving && raystream.spp > 1")
        self.assertNotEqual(self.pixels(page), before)


if __name__ == "__main__":
    service.unittest.main()
