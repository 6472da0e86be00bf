// Compiles a job of Flamenco with a job type, as its manager does, and prints the tasks as JSON.
//   node flamenco.mjs JOB_TYPE.js '{"scene": ..}'
import { readFileSync } from "node:fs";
import { runInNewContext } from "node:vm";

const [script, given] = process.argv.slice(2);
const tasks = [];

// What the manager offers to job types that is used here. Its names of commands and parameters are those of workers.
const author = {
    Task(name, type) {
        const task = { name, type, commands: [], dependencies: [] };
        return Object.assign(task, {
            addCommand: (command) => task.commands.push(command),
            addDependency: (other) => task.dependencies.push(other.name),
        });
    },
    Command: (name, parameters) => ({ name, parameters }),
};

function shellSplit(text) {
    return text.split(/\s+/).filter((word) => word !== "");
}

function frameChunker(frames, size) {
    if (size !== 1) throw new Error("one frame a task");
    return frames.split(",").flatMap((range) => {
        const [first, last = first] = range.split("-").map(Number);
        return Array.from({ length: last - first + 1 }, (_, index) => `${first + index}`);
    });
}

const source = `${readFileSync(script, "utf8")}; ({ JOB_TYPE, compileJob })`;
const { JOB_TYPE, compileJob } = runInNewContext(source, { author, shellSplit, frameChunker });
const settings = Object.fromEntries(JOB_TYPE.settings.map((setting) => [setting.key, setting.default]));
for (const [key, value] of Object.entries(JSON.parse(given))) {
    if (!(key in settings)) throw new Error(`${key} is no setting`);
    settings[key] = value;
}
for (const { key, required } of JOB_TYPE.settings) {
    if (required && settings[key] === undefined) throw new Error(`${key} is missing`);
}
compileJob({ settings, addTask: (task) => tasks.push(task) });
console.log(JSON.stringify({ settings: JOB_TYPE.settings, tasks }));
