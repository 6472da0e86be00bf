// A job type of Flamenco: renders a picture in parts, each a range of samples, and merges them; or, if there are
// frames, one task a frame. Put this file into the folder `scripts` beside flamenco-manager, and restart it. Workers
// must see the same files and have the task type `raystream`. The manager's variable `raystream` is the program's path.

const JOB_TYPE = {
    label: "raystream",
    settings: [
        { key: "scene", type: "string", subtype: "file_path", required: true, description: "The scene" },
        { key: "output", type: "string", subtype: "file_path", required: true,
          description: "The picture; of frames with the number as %04d: out.%04d.png" },
        { key: "spp", type: "int32", default: 256, propargs: { min: 1 }, description: "Samples per pixel" },
        { key: "parts", type: "int32", default: 8, propargs: { min: 1 }, description: "Parts of a picture" },
        { key: "frames", type: "string", default: "", description: "Frames, as 0-119; empty for a still picture" },
        { key: "options", type: "string", default: "", description: "More options of raystream render" },
    ],
};

// A task that runs raystream.
function authorTask(name, args) {
    const task = author.Task(name, "raystream");
    task.addCommand(author.Command("exec", { exe: "{raystream}", args: args }));
    return task;
}

function authorFrames(job, options) {
    const { scene, output, spp, frames } = job.settings;
    for (const chunk of frameChunker(frames, 1)) {
        const frame = parseInt(chunk, 10);
        const range = `${frame}..${frame + 1}`;
        const args = ["render", scene, ...options, "--spp", `${spp}`, "-o", output, "--frames", range];
        job.addTask(authorTask(`frame-${frame}`, [...args, "--progress", "plain"]));
    }
}

function authorParts(job, options) {
    const { scene, output, spp } = job.settings;
    const parts = Math.min(job.settings.parts, spp);
    const films = [];
    const merge = author.Task("merge", "raystream");
    for (let part = 0; part < parts; part++) {
        const first = Math.floor((part * spp) / parts);
        const end = Math.floor(((part + 1) * spp) / parts);
        const film = `${output}.${part}.rayfilm`;
        const args = ["render", scene, ...options, "--spp", `${spp}`, "--samples", `${first}..${end}`];
        const task = authorTask(`part-${part}`, [...args, "--partial", film, "--progress", "plain"]);
        merge.addDependency(task);
        job.addTask(task);
        films.push(film);
    }
    merge.addCommand(author.Command("exec", { exe: "{raystream}", args: ["merge", ...films, "-o", output] }));
    job.addTask(merge);
}

function compileJob(job) {
    const { spp, parts, frames, options } = job.settings;
    if (spp < 1 || parts < 1) {
        throw "spp and parts must be at least 1";
    }
    const words = shellSplit(options || "");
    if (frames) {
        authorFrames(job, words);
    } else {
        authorParts(job, words);
    }
}
