"""The live view in a browser."""

import json
import re

import service


class Live(service.Case):
    def test_the_picture_comes_and_becomes_better(self):
        page = self.page()
        self.wait_for(page, "raystream.spp > 0")
        samples = [page.evaluate("raystream.spp")]
        for _ in range(2):
            self.wait_for(page, f"!raystream.moving && raystream.spp > {samples[-1]}")
            samples.append(page.evaluate("raystream.spp"))
        self.assertEqual(samples, sorted(samples))
        self.assertIn("scene.json", page.get_by_test_id("scene-name").inner_text())

    def test_orbiting_changes_the_picture_and_its_generation(self):
        page = self.live()
        before, generation = self.pixels(page), page.evaluate("raystream.gen")
        flags = page.get_by_test_id("camera-flags").inner_text()
        self.drag(page, 160, 20)
        self.wait_for(page, f"raystream.gen > {generation} && !raystream.moving")
        self.assertNotEqual(self.pixels(page), before)
        turned = page.get_by_test_id("camera-flags").inner_text()
        self.assertNotEqual(turned, flags)
        self.assertRegex(turned, r"^--eye \S+ --target \S+ --up \S+ --fov \S+$")

    @service.page_alone
    def test_keys_walk_frame_and_reset(self):
        page = self.live()
        flags = page.get_by_test_id("camera-flags")
        home = flags.inner_text()
        page.get_by_test_id("picture").focus()
        seen = {home}
        for key in ("f", "ArrowLeft", "ArrowUp"):
            page.keyboard.press(key)
            seen.add(flags.inner_text())
        page.keyboard.down("w")
        page.wait_for_timeout(200)
        page.keyboard.up("w")
        seen.add(flags.inner_text())
        self.assertEqual(len(seen), 5)
        page.keyboard.press("r")
        self.assertEqual(flags.inner_text(), home)

    def test_stale_frames_are_never_shown(self):
        page = self.page(token="")
        kept = []

        def through(socket):
            server = socket.connect_to_server()

            def pass_on(message):
                socket.send(message)
                if isinstance(message, bytes):
                    kept.append(message)
                    # The first frame of all comes again after each other one.
                    socket.send(kept[0])

            server.on_message(pass_on)

        page.route_web_socket(re.compile("/api/v1/live"), through)
        page.goto("about:blank")
        page.goto(f"{self.service.url}#token={self.service.token}")
        self.wait_for(page, "raystream.frames > 0 && !raystream.moving")
        page.evaluate("""() => {
            window.fell = false;
            let last = [0, 0];
            const look = () => {
                const { gen, sequence } = window.raystream;
                if (gen < last[0] || sequence < last[1]) window.fell = true;
                last = [gen, sequence];
                requestAnimationFrame(look);
            };
            look();
        }""")
        generation = page.evaluate("raystream.gen")
        self.drag(page, 120, 0, steps=30)
        self.wait_for(page, f"raystream.gen > {generation} && !raystream.moving")
        self.assertGreater(len(kept), 3)
        self.assertFalse(page.evaluate("window.fell"))

    @service.page_alone
    def test_a_click_selects_a_material_whose_edit_is_shown(self):
        page = self.live()
        box = page.get_by_test_id("picture").bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        name = page.get_by_test_id("material-name")
        name.get_by_text("ball").wait_for()
        self.assertIn("ball", page.get_by_test_id("pick-material").inner_text())
        generation = page.evaluate("raystream.gen")
        page.get_by_test_id("base-colour").fill("#2040ff")
        self.wait_for(page, f"raystream.gen > {generation} && !raystream.moving")
        middle = page.evaluate("""() => {
            const canvas = document.getElementById('picture');
            const middle = [canvas.width / 2, canvas.height / 2, 1, 1];
            return [...canvas.getContext('2d').getImageData(...middle).data];
        }""")
        self.assertGreater(middle[2], middle[0], "the ball is blue")
        page.get_by_test_id("shader").fill("fn pattern(at: Point) -> Finish { return mate(at); }")
        page.get_by_test_id("shader-error").get_by_text("ball.wgsl:1:").wait_for()
        generation = page.evaluate("raystream.gen")
        page.get_by_test_id("shader").fill("fn pattern(at: Point) -> Finish { return matte(at); }")
        self.wait_for(page, f"raystream.gen > {generation} && !raystream.moving")
        page.get_by_test_id("shader-error").wait_for(state="hidden")

    def test_looks_layers_and_files(self):
        page = self.live()
        before = self.pixels(page)
        page.get_by_test_id("view").select_option("standard")
        page.wait_for_function("before => document.getElementById('picture').toDataURL() !== before", arg=before)
        generation = page.evaluate("raystream.gen")
        page.get_by_test_id("layer").select_option("normal")
        self.wait_for(page, f"raystream.gen > {generation} && !raystream.moving")
        for kind, magic in (("png", b"\x89PNG"), ("exr", b"\x76\x2f\x31\x01")):
            with page.expect_download() as download:
                page.get_by_test_id(f"save-{kind}").click()
            self.assertTrue(download.value.path().read_bytes().startswith(magic))

    @service.page_alone
    def test_the_saved_spec_renders_the_picture_that_was_shown(self):
        page = self.live()
        generation = page.evaluate("raystream.gen")
        self.drag(page, 90, 20)
        page.get_by_text("Render", exact=True).click()
        page.get_by_test_id("target-spp").fill("3")
        page.get_by_test_id("target-spp").press("Enter")
        self.wait_for(page, f"raystream.gen > {generation} + 1 && raystream.spp >= 3 && !raystream.moving")
        with page.expect_download() as picture:
            page.get_by_test_id("save-png").click()
        with page.expect_download() as saved:
            page.get_by_test_id("save-spec").click()
        spec = json.loads(saved.value.path().read_text())
        self.assertEqual((spec["scene"], spec["spp"]), ("scene.json", 3))
        again = self.service.render(spec)
        self.assertEqual(self.colours(page, again), self.colours(page, picture.value.path().read_bytes()))

    def test_two_viewers_have_cameras_of_their_own(self):
        one = self.live()
        other = self.live()
        flags = other.get_by_test_id("camera-flags").inner_text()
        generation = one.evaluate("raystream.gen")
        self.drag(one, 100, 0)
        self.wait_for(one, f"raystream.gen > {generation} && !raystream.moving")
        self.wait_for(other, "raystream.spp > 1")
        self.assertEqual(other.get_by_test_id("camera-flags").inner_text(), flags)

    def test_the_page_goes_on_after_a_restart_of_the_service(self):
        page = self.live()
        self.drag(page, 90, 0)
        flags = page.get_by_test_id("camera-flags").inner_text()
        self.service.kill()
        page.locator('[data-testid="connection"][data-state="retry"]').wait_for()
        self.service.start()
        page.locator('[data-testid="connection"][data-state="open"]').wait_for()
        frames = page.evaluate("raystream.frames")
        self.wait_for(page, f"raystream.frames > {frames} && !raystream.moving")
        self.assertEqual(page.get_by_test_id("camera-flags").inner_text(), flags)

    def test_a_wrong_token_is_refused_and_the_right_one_is_not(self):
        page = self.page(token="")
        dialog = page.get_by_test_id("token-dialog")
        dialog.wait_for()
        page.get_by_test_id("token").fill("0" * 64)
        page.get_by_test_id("token-send").click()
        page.get_by_test_id("token-error").get_by_text("wrong").wait_for()
        self.assertTrue(dialog.is_visible())
        page.get_by_test_id("token").fill(self.service.token)
        page.get_by_test_id("token-send").click()
        dialog.wait_for(state="hidden")
        self.wait_for(page, "raystream.frames > 0")

    @service.page_alone
    def test_no_panel_is_wider_than_a_narrow_screen(self):
        for scheme in ("light", "dark"):
            page = self.live(width=360, height=720, color_scheme=scheme, has_touch=True)
            for name in ("live", "jobs"):
                page.get_by_test_id(f"to-{name}").click()
                page.get_by_test_id(name).wait_for()
                wide = page.evaluate("document.documentElement.scrollWidth")
                self.assertLessEqual(wide, 360, f"{name}, {scheme}")

    @service.page_alone
    def test_controls_have_names(self):
        page = self.live()
        kinds = "button, input, select, textarea, canvas"
        unnamed = page.evaluate("""(kinds) => [...document.querySelectorAll(kinds)]
            .filter((e) => e.getAttribute('aria-hidden') !== 'true')
            .filter((e) => !(e.labels?.length || e.getAttribute('aria-label') || e.textContent.trim()))
            .map((e) => e.outerHTML)""", kinds)
        self.assertEqual(unnamed, [])


class Moving(service.Case):
    """A scene with two animations."""

    SCENE = "moving.gltf", service.moving_gltf()

    # The full picture of the newest change is shown. The picture before it may be a full one as well.
    COMPLETE = "!raystream.playing && raystream.gen === raystream.asked && raystream.last"

    def few(self):
        """A page whose full pictures have few samples."""
        page = self.live()
        page.get_by_text("Render", exact=True).click()
        page.get_by_test_id("target-spp").fill("3")
        page.get_by_test_id("target-spp").press("Enter")
        self.wait_for(page, "raystream.spp === 3 && raystream.last")
        return page

    def test_it_plays_by_the_clock_pauses_and_scrubs(self):
        page = self.few()
        page.get_by_test_id("time-bar").wait_for()
        rest = self.pixels(page)
        page.get_by_test_id("play").click()
        self.wait_for(page, "raystream.playing && raystream.seconds > 0.2 && raystream.moving")
        # Twenty looks at the clock and at the time that is shown: as much has passed of both.
        passed = page.evaluate("""async () => {
            const looks = [];
            for (let i = 0; i < 20; i++) {
                looks.push([performance.now() / 1000, window.raystream.seconds, window.raystream.frames]);
                await new Promise((resolve) => setTimeout(resolve, 40));
            }
            return looks;
        }""")
        clock = [after[0] - before[0] for before, after in zip(passed, passed[1:])]
        shown = [(after[1] - before[1]) % 1 for before, after in zip(passed, passed[1:])]
        self.assertAlmostEqual(sum(shown), sum(clock), delta=0.15)
        self.assertGreater(passed[-1][2] - passed[0][2], 4, "frames of the motion are shown")
        page.get_by_test_id("play").click()
        self.wait_for(page, self.COMPLETE)
        paused = page.evaluate("raystream.seconds")
        page.wait_for_timeout(300)
        self.assertEqual(page.evaluate("raystream.seconds"), paused)
        self.assertNotEqual(self.pixels(page), rest)
        # The other animation, at a time of the slider.
        page.get_by_test_id("animation").select_option("up")
        generation = page.evaluate("raystream.gen")
        page.get_by_test_id("time").fill("1.5")
        self.assertEqual(page.get_by_test_id("time-value").inner_text(), "1.50 s")
        self.wait_for(page, f"raystream.gen > {generation} && raystream.seconds === 1.5 && raystream.last")
        with page.expect_download() as picture:
            page.get_by_test_id("save-png").click()
        with page.expect_download() as saved:
            page.get_by_test_id("save-spec").click()
        spec = json.loads(saved.value.path().read_text())
        self.assertEqual((spec["time"], spec["animation"]), (1.5, "up"))
        again = self.service.render(spec)
        self.assertEqual(self.colours(page, again), self.colours(page, picture.value.path().read_bytes()))

    def test_the_space_bar_plays_and_the_time_stays_after_a_restart(self):
        page = self.few()
        page.get_by_test_id("time").fill("0.25")
        page.get_by_test_id("picture").focus()
        page.keyboard.press(" ")
        self.wait_for(page, "raystream.playing && raystream.seconds > 0.3")
        page.keyboard.press(" ")
        self.wait_for(page, self.COMPLETE)
        seconds, before = page.evaluate("raystream.seconds"), self.pixels(page)
        self.service.kill()
        page.locator('[data-testid="connection"][data-state="retry"]').wait_for()
        self.service.start()
        page.locator('[data-testid="connection"][data-state="open"]').wait_for()
        frames = page.evaluate("raystream.frames")
        self.wait_for(page, f"raystream.frames > {frames} && {self.COMPLETE}")
        self.assertEqual(page.evaluate("raystream.seconds"), seconds)
        self.assertEqual(self.pixels(page), before)


class Nothing(service.Case):
    def test_what_is_refused_is_told_and_not_asked_for_again(self):
        page = self.live()
        opened = []
        page.on("websocket", lambda socket: opened.append(socket.url))
        page.evaluate("location.hash = 'live=' + '0'.repeat(64)")
        page.get_by_test_id("connection").get_by_text("nothing to show").wait_for()
        self.assertIn("upload it first", page.get_by_test_id("notice").inner_text())
        page.wait_for_timeout(1500)
        self.assertEqual(len(opened), 1)
        # A scene that cannot be read is refused in the words of the process that has read it.
        content = '{ "shapes": [ { "shape": "no such shape", "material": "grey" } ] }'
        scene = page.evaluate("""async (body) => {
            const digest = await crypto.subtle.digest("SHA-256", new TextEncoder().encode(body));
            const hash = [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
            await fetch(`api/v1/scenes/${hash}`, { method: "PUT", body });
            return hash;
        }""", content)
        page.evaluate("scene => { location.hash = `live=${scene}`; }", scene)
        page.get_by_test_id("notice").get_by_text("no such shape").wait_for()
        self.assertNotIn(str(self.folder), page.get_by_test_id("notice").inner_text())
        # The next scene has none of that.
        page.evaluate("location.hash = 'live'")
        self.wait_for(page, "raystream.frames > 0")
        page.get_by_test_id("connection").get_by_text("connected").wait_for()
        notice = page.get_by_test_id("notice")
        self.assertTrue(notice.is_hidden(), notice.inner_text())


if __name__ == "__main__":
    service.unittest.main()
