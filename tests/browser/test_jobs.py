"""Jobs in a browser."""

import service


class Jobs(service.Case):
    OPTIONS = ("--max-upload", "4K")

    def jobs(self):
        page = self.page()
        page.get_by_test_id("to-jobs").click()
        page.get_by_test_id("jobs").wait_for()
        return page

    def give(self, page, name, content):
        file = {"name": name, "mimeType": "model/gltf-binary", "buffer": content}
        page.get_by_test_id("file").set_input_files(files=[file])

    def test_pages_speak_the_protocol_that_they_should(self):
        page = self.jobs()
        protocol = page.evaluate("performance.getEntriesByType('navigation')[0].nextHopProtocol")
        self.assertEqual(protocol, "h2" if service.TLS else "http/1.1")

    def test_an_upload_is_rendered(self):
        page = self.jobs()
        self.give(page, "triangle.glb", service.triangle_glb())
        page.get_by_test_id("upload").get_by_text("is being rendered").wait_for()
        # Another test may have asked for the same picture; then its job answers.
        job = page.get_by_test_id("job").filter(has_text="960×540").first
        job.get_by_text("done").wait_for(timeout=120000)
        page.wait_for_function("thumb => thumb.naturalWidth > 0", arg=job.locator(".thumb").element_handle())

    def test_an_upload_that_is_too_large_is_explained(self):
        page = self.jobs()
        self.give(page, "large.glb", b"glTF" + bytes(10000))
        told = page.get_by_test_id("upload")
        told.get_by_text("refused").wait_for()
        self.assertIn("4096 bytes", told.inner_text())

    def test_a_job_is_cancelled_and_tried_again(self):
        page = self.jobs()
        self.give(page, "triangle.glb", service.triangle_glb())
        page.get_by_test_id("upload").get_by_text("is being rendered").wait_for()
        scene = page.evaluate("async () => (await (await fetch('api/v1/jobs?limit=1')).json()).jobs[0].scene")
        name = page.evaluate("""async (scene) => (await (await fetch('api/v1/jobs', { method: 'POST', headers: {
            'Content-Type': 'application/json' }, body: JSON.stringify({ scene, options: { size: '1920x1080',
            spp: 100000 } }) })).json()).id""", scene)
        job = page.locator(f"[data-testid=job][data-id='{name}']")
        job.get_by_text("running").wait_for()
        job.get_by_test_id("job-cancel").click()
        job.get_by_text("cancelled").wait_for()
        job.get_by_test_id("job-retry").click()
        job.get_by_text("running").wait_for()
        job.get_by_test_id("job-cancel").click()
        job.get_by_text("cancelled").wait_for()

    def test_a_job_is_pinned_and_deleted(self):
        page = self.jobs()
        self.give(page, "triangle.glb", service.triangle_glb())
        page.get_by_test_id("upload").get_by_text("is being rendered").wait_for()
        scene = page.evaluate("async () => (await (await fetch('api/v1/jobs?limit=1')).json()).jobs[0].scene")
        name = page.evaluate("""async (scene) => (await (await fetch('api/v1/jobs', { method: 'POST', headers: {
            'Content-Type': 'application/json' }, body: JSON.stringify({ scene, size: '8x8', spp: 1, seed: 77 })
            })).json()).id""", scene)
        job = page.locator(f"[data-testid=job][data-id='{name}']")
        job.get_by_text("done").wait_for()
        job.get_by_test_id("job-pin").click()
        job.get_by_text("Unpin").wait_for()
        self.assertFalse(job.get_by_test_id("job-delete").is_visible())
        job.get_by_text("Unpin").click()
        page.once("dialog", lambda dialog: dialog.dismiss())
        job.get_by_test_id("job-delete").click()
        self.assertTrue(job.is_visible(), "it was not meant so")
        page.once("dialog", lambda dialog: dialog.accept())
        job.get_by_test_id("job-delete").click()
        job.wait_for(state="detached")


if __name__ == "__main__":
    service.unittest.main()
