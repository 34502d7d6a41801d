// SPDX-License-Identifier: GPL-3.0-or-later

// A job type of Flamenco 3 that bakes a job file of Imprint: one task checks it, others bake a part each, the last one merges
// their reports. It belongs into the folder "scripts" beside Flamenco Manager.

const JOB_TYPE = {
    label: "Imprint Bake",
    settings: [
        { key: "jobs", label: "Job File", type: "string", subtype: "file_path", required: true,
          description: "Job file with the bakes, at a path that all workers see" },
        { key: "shards", label: "Parts", type: "int32", default: 16, propargs: {min: 1, max: 1000},
          description: "Number of parts of about the same cost. Each part is a task" },
        { key: "force", label: "Force", type: "bool", default: false,
          description: "Bake again what is already done" },
        { key: "options", label: "Options", type: "string", default: "",
          description: "Further options for all bakes, such as --size 4096" },
        { key: "reports", label: "Reports", type: "string", subtype: "dir_path", default: "",
          description: "Folder for reports and logs. If it is empty, they are written beside the job file" },
        { key: "command", label: "Command", type: "string", default: "{blender} --background --command imprint",
          description: "What starts Imprint. With a checkout: python3 /PATH/TO/scripts/imprint.py bake" },
    ]
};


function compileJob(job) {
    const settings = job.settings;
    const jobs = settings.jobs;
    const reports = settings.reports || path.join(path.dirname(jobs), `${path.stem(jobs)}-reports`);
    const options = words(settings.options || "");
    const done = settings.force ? "--force" : "--resume";
    const checkTask = authorTask(settings, "check", ["--jobs"], jobs, ["--check", done, ...options]);
    job.addTask(checkTask);

    const mergeArgs = ["--sheet", path.join(reports, "report.html")];
    const bakeTasks = [];
    for (let shard = 1; shard <= settings.shards; shard++) {
        const report = path.join(reports, `report.${shard}.json`);
        const task = authorTask(settings, `bake-${shard}-of-${settings.shards}`, ["--jobs"], jobs, [
            "--shard", `${shard}/${settings.shards}`,
            done,
            "--report", report,
            "--log", path.join(reports, "logs"),
            ...options,
        ]);
        task.addDependency(checkTask);
        bakeTasks.push(task);
        mergeArgs.push(report);
    }

    const mergeTask = authorTask(settings, "merge", ["report", "--merge"], path.join(reports, "report.json"), mergeArgs);
    for (const task of bakeTasks) {
        mergeTask.addDependency(task);
        job.addTask(task);
    }
    job.addTask(mergeTask);
}

// A task that runs Imprint. The command "blender-render" is the one that shows pictures, and it needs a file among its words:
// `file` stands between the other two, and may be any.
function authorTask(settings, name, before, file, after) {
    const [program, ...first] = words(settings.command);
    const task = author.Task(name, "blender");
    task.addCommand(author.Command("blender-render", {
        exe: program,
        argsBefore: [...first, ...before],
        blendfile: file,
        args: after,
    }));
    return task;
}

// Split a text at spaces. Double quotes keep spaces.
function words(text) {
    return (text.match(/"[^"]*"|\S+/g) || []).map(word => word.replace(/^"(.*)"$/, "$1"));
}
