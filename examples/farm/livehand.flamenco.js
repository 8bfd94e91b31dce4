// Flamenco 3 job type: one shot in chunks, each a task. Put it into the Manager's `scripts` folder; see docs/use/farms.md.
// A task that fails is tried again by the Manager, and goes on where it ended. Exit codes: docs/use/exit_codes.md.

const JOB_TYPE = {
    label: "LiveHand",
    description: "Render the hands of a shot; existing frames are skipped",
    settings: [
        { key: "frames", type: "string", required: true,
          eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          description: "Frames and ranges, such as 1-24,30" },
        { key: "chunk_count", type: "int32", default: 4, propargs: { min: 1, max: 1024 },
          description: "Number of tasks that the frames are divided into" },
        { key: "output", type: "string", subtype: "dir_path", required: true,
          description: "Folder of the frames, shared by all workers" },
        { key: "format", type: "string", required: true, default: "exr", choices: ["exr", "png", "exr,png"],
          description: "File format of the frames; both come from one render" },
        { key: "livehand", type: "string", required: true, default: "livehand", visible: "submission",
          description: "The livehand program on the workers" },
        { key: "blendfile", type: "string", required: true, visible: "web",
          description: "The shot; filled in by the add-on" },
    ],
};

function compileJob(job) {
    for (let number = 1; number <= job.settings.chunk_count; number++) {
        job.addTask(renderTask(job.settings, `${number}/${job.settings.chunk_count}`));
    }
}

function renderTask(settings, chunk) {
    const task = author.Task(`render-${chunk}`, "blender");
    task.addCommand(author.Command("exec", {
        exe: settings.livehand,
        args: [
            "render", settings.blendfile,
            "--output", settings.output,
            `--frames=${settings.frames}`,
            `--format=${settings.format}`,
            `--chunk=${chunk}`,
            "--strict",
            "--json",
        ],
    }));
    return task;
}
