//! Several volumes prepared by one command: what each is written to, who works on it, and what came of all.

use std::ffi::OsString;
use std::fmt::Write;
use std::fs;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Context, anyhow, ensure};
use serde_json::{Value, json};
use voxrole_pack::prologue::MAGIC;
use voxrole_preprocess::report::Report;
use voxrole_preprocess::usage::{UsageError, refuse_if};

/// One volume and the packed file that it becomes.
#[derive(Clone, Debug)]
pub struct Task {
    pub input: PathBuf,
    pub output: PathBuf,
}

/// The tasks of `-o output`: one file, or a folder with a file for each input.
///
/// # Errors
/// When an input has no name, or two would be written to the same file.
pub fn tasks(inputs: &[PathBuf], output: &Path) -> anyhow::Result<Vec<Task>> {
    if let [input] = inputs
        && !names_folder(output)
    {
        return Ok(vec![Task { input: input.clone(), output: output.to_owned() }]);
    }
    let is_packed_name = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vxr"));
    let (named, count) = (output.display(), inputs.len());
    refuse_if(
        is_packed_name && !names_folder(output),
        format!("{named}: expected a folder for the packed files of {count} volumes, found the name of one file"),
    )?;
    let mut tasks: Vec<Task> = Vec::with_capacity(inputs.len());
    for input in inputs {
        let name = packed_name(input).with_context(|| format!("{}: not the name of a file", input.display()))?;
        let output = output.join(name);
        if let Some(other) = tasks.iter().find(|task| super::is_same_file(&task.output, &output)) {
            let (a, b) = (other.input.display(), input.display());
            let message = format!("{a} and {b} would both be written to {}: rename one", output.display());
            return Err(UsageError(message).into());
        }
        tasks.push(Task { input: input.clone(), output });
    }
    Ok(tasks)
}

/// Whether one input with this output is written into a folder.
fn names_folder(output: &Path) -> bool {
    output.is_dir() || output.to_string_lossy().ends_with(std::path::is_separator)
}

/// `engine.nrrd` becomes `engine.vxr`, and so does `engine.nii.gz`; folders have no extension, whatever their name.
fn packed_name(input: &Path) -> Option<OsString> {
    let name = Path::new(input.file_name()?);
    let mut stem = if input.is_dir() { name.to_owned() } else { name.with_extension("") };
    let had = |path: &Path, name: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(name));
    if had(input, "gz") && had(&stem, "nii") {
        stem.set_extension("");
    }
    let mut name = stem.into_os_string();
    name.push(".vxr");
    Some(name)
}

/// Checks, before any work is done, that all outputs can be written and none is an input; makes the folder, which is left
/// only if everything is in order.
///
/// # Errors
/// The first output that cannot be written.
pub fn check_outputs(tasks: &[Task], folder: Option<&Path>, report: Option<&Path>) -> anyhow::Result<()> {
    let is_made = folder.map_or(Ok(false), super::make_folder)?;
    let checked = check_each(tasks, report);
    if let (Err(_), true, Some(folder)) = (&checked, is_made, folder) {
        // Whoever cannot remove it can do nothing more about it.
        let _ = fs::remove_dir(folder);
    }
    checked
}

fn check_each(tasks: &[Task], report: Option<&Path>) -> anyhow::Result<()> {
    let inputs: Vec<&Path> = tasks.iter().map(|task| task.input.as_path()).collect();
    for output in tasks.iter().map(|task| task.output.as_path()).chain(report) {
        super::check_output(output, &inputs, None)?;
    }
    for task in tasks {
        check_replaced(&task.output, ["packed file", "vxr"], |start| start == MAGIC)?;
    }
    if let Some(report) = report {
        check_replaced(report, ["report", "json"], |start| matches!(start.first(), Some(b'{' | b'[')))?;
    }
    if let Some(report) = report {
        let is_taken = tasks.iter().any(|task| super::is_same_file(&task.output, report));
        refuse_if(is_taken, format!("{}: two outputs cannot be one file", report.display()))?;
    }
    Ok(())
}

/// Makes sure that what an output would replace is of its own kind: a name typed wrong must not cost a volume.
fn check_replaced(output: &Path, [kind, extension]: [&str; 2], is_kind: fn(&[u8]) -> bool) -> anyhow::Result<()> {
    let named = || output.display().to_string();
    if !output.exists() || output.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension)) {
        return Ok(());
    }
    let mut start = Vec::new();
    let file = fs::File::open(output).with_context(named)?;
    file.take(MAGIC.len() as u64).read_to_end(&mut start).with_context(named)?;
    ensure!(
        start.is_empty() || is_kind(&start),
        "{}: expected a {kind} or nothing under the name of the output, found another file: choose another name, or \
         remove that file first if nobody needs it",
        named()
    );
    Ok(())
}

/// Makes sure that no output is one of the files that hold an input's numbers, which are known only once it is opened.
///
/// # Errors
/// The first output that is.
pub fn check_files(tasks: &[Task], report: Option<&Path>, files: &[PathBuf]) -> anyhow::Result<()> {
    let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let outputs = tasks.iter().map(|task| task.output.as_path()).chain(report);
    outputs.filter(|output| output.exists()).try_for_each(|output| super::check_output(output, &files, None))
}

/// What came of a task.
pub type Outcome = anyhow::Result<Done>;

/// What came of a task that did not fail.
#[derive(Debug)]
pub enum Done {
    /// The packed file was written.
    Prepared(Box<Report>),
    /// The packed file was there already, and was to be left alone; with what an earlier report has of it.
    Skipped(Option<Value>),
}

impl Done {
    /// Of a task whose packed file was written; the report names the input as it was typed.
    pub fn prepared(report: Report, task: &Task) -> Self {
        Self::Prepared(Box::new(Report { input: named(&task.input), ..report }))
    }
}

/// What `--report` writes of a task: a report, of this run or of an earlier one, or the input and what came of it.
pub fn entry(task: &Task, outcome: &Outcome) -> Value {
    match outcome {
        Ok(Done::Prepared(report)) => json!(report),
        Ok(Done::Skipped(Some(before))) => before.clone(),
        Ok(Done::Skipped(None)) => json!({ "input": named(&task.input), "skipped": true }),
        Err(error) => json!({ "input": named(&task.input), "error": format!("{error:#}") }),
    }
}

/// What a report that is about to be replaced has of volumes that were prepared; nothing where it is none.
pub fn reports_of(report: &Path) -> Vec<Value> {
    let entries = fs::read(report).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let entries = match entries {
        Some(Value::Array(entries)) => entries,
        Some(entry) => vec![entry],
        None => Vec::new(),
    };
    entries.into_iter().filter(|entry| entry.get("counts").is_some()).collect()
}

/// The one of them about a task's input and the packed file that is there.
pub fn report_of(task: &Task, reports: &[Value]) -> Option<Value> {
    let file_bytes = fs::metadata(&task.output).ok()?.len();
    let is_it = |report: &&Value| report["input"] == named(&task.input) && report["file_bytes"] == file_bytes;
    reports.iter().find(is_it).cloned()
}

/// How many tasks came to which end.
pub struct Tally {
    pub prepared: usize,
    pub skipped: usize,
    pub failed: usize,
}

impl Tally {
    /// Of all outcomes.
    pub fn new(outcomes: &[Outcome]) -> Self {
        let count = |is_it: fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is_it(outcome)).count();
        Self {
            prepared: count(|outcome| matches!(outcome, Ok(Done::Prepared(_)))),
            skipped: count(|outcome| matches!(outcome, Ok(Done::Skipped(_)))),
            failed: count(Result::is_err),
        }
    }
}

/// Runs `work` on every task, `jobs` at a time, and tells each outcome at once; they are returned in the order of the tasks.
/// A panic is the failure of its task.
pub fn run(
    tasks: &[Task],
    jobs: usize,
    work: impl Fn(&Task) -> Outcome + Sync,
    tell: impl Fn(&Task, &Outcome) + Sync,
) -> Vec<Outcome> {
    let next = AtomicUsize::new(0);
    let take_turns = || {
        let mut outcomes = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(task) = tasks.get(index) else { return outcomes };
            // What a panic leaves half done belongs to its own task.
            let outcome = catch_unwind(AssertUnwindSafe(|| work(task))).unwrap_or_else(|_| {
                Err(anyhow!("{}: a fault of this program; please report it", task.input.display()))
            });
            tell(task, &outcome);
            outcomes.push((index, outcome));
        }
    };
    let mut outcomes = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs).map(|_| scope.spawn(take_turns)).collect();
        let joined = workers.into_iter().map(std::thread::ScopedJoinHandle::join);
        joined.flat_map(|joined| joined.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect::<Vec<_>>()
    });
    outcomes.sort_by_key(|(index, _)| *index);
    outcomes.into_iter().map(|(_, outcome)| outcome).collect()
}

/// A line for each task, and one for all.
pub fn table(tasks: &[Task], outcomes: &[Outcome]) -> String {
    let mut text = lines(tasks, outcomes.iter().map(|outcome| Some(columns_of(outcome))));
    let Tally { prepared, skipped, failed } = Tally::new(outcomes);
    let there = if skipped > 0 { format!("{skipped} there already, ") } else { String::new() };
    // Writing to a string does not fail.
    let _ = writeln!(text, "{}: {prepared} prepared, {there}{failed} failed", volumes(tasks));
    text
}

fn volumes(tasks: &[Task]) -> String {
    if tasks.len() == 1 { "1 volume".into() } else { format!("{} volumes", tasks.len()) }
}

/// The columns behind a task's name.
fn columns_of(outcome: &Outcome) -> String {
    match outcome {
        Ok(Done::Prepared(report)) => {
            let Report { counts, seconds, file_bytes, .. } = &**report;
            let share = 100.0 * counts.hits as f64 / counts.voxels as f64;
            let voxels = counts.voxels;
            format!("{voxels:>12}  {share:>6.1}  {seconds:>9.2}  {file_bytes:>12}")
        }
        Ok(Done::Skipped(_)) => "was there already".to_owned(),
        Err(error) => format!("error: {}", one_line(&format!("{error:#}"))),
    }
}

/// A heading, and a line for each task.
fn lines(tasks: &[Task], columns: impl Iterator<Item = Option<String>>) -> String {
    let names: Vec<_> = tasks.iter().map(|task| one_line(&file_name(&task.input))).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max("volume".len());
    let mut text =
        format!("{:width$}  {:>12}  {:>6}  {:>9}  {:>12}\n", "volume", "voxels", "hits %", "seconds", "bytes");
    for (name, columns) in names.iter().zip(columns) {
        let _ = writeln!(text, "{name:width$}  {}", columns.as_deref().unwrap_or("not done"));
    }
    text
}

/// What came of the tasks of a run that is not over, for an interrupt to print.
static SO_FAR: Mutex<Option<SoFar>> = Mutex::new(None);

struct SoFar {
    tasks: Vec<Task>,
    /// What is known of each.
    states: Vec<State>,
    /// Where the report is to be written.
    report: Option<PathBuf>,
}

/// What is known of a task.
struct State {
    /// Its columns in the table, once it is done.
    columns: Option<String>,
    has_failed: bool,
    /// Its entry in the report.
    entry: Value,
}

/// Takes note of the tasks of a run, none of which is done, of the report that is to be written, and of what there is in it
/// about packed files that are there.
pub fn begin(tasks: &[Task], report: Option<&Path>, reports: &[Value]) {
    let state = |task: &Task| {
        let interrupted = || json!({ "input": named(&task.input), "interrupted": true });
        State { columns: None, has_failed: false, entry: report_of(task, reports).unwrap_or_else(interrupted) }
    };
    let states = tasks.iter().map(state).collect();
    *so_far() = Some(SoFar { tasks: tasks.to_vec(), states, report: report.map(Path::to_owned) });
}

/// Takes note of what came of a task, also in the report on several.
///
/// # Errors
/// When the report cannot be written.
pub fn note(task: &Task, outcome: &Outcome) -> anyhow::Result<()> {
    if let Some(SoFar { tasks, states, .. }) = &mut *so_far()
        && let Some(index) = tasks.iter().position(|of| of.output == task.output)
    {
        let (columns, has_failed) = (Some(columns_of(outcome)), outcome.is_err());
        states[index] = State { columns, has_failed, entry: entry(task, outcome) };
    }
    write_report()
}

/// Whether something is still to be prepared.
pub fn is_preparing() -> bool {
    so_far().as_ref().is_some_and(|so_far| so_far.states.iter().any(|state| state.columns.is_none()))
}

/// The table of a run of several tasks that is not over.
pub fn table_so_far() -> Option<String> {
    let so_far = so_far();
    let SoFar { tasks, states, .. } = so_far.as_ref().filter(|so_far| so_far.tasks.len() > 1)?;
    let mut text = lines(tasks, states.iter().map(|state| state.columns.clone()));
    let failed = states.iter().filter(|state| state.has_failed).count();
    let left = states.iter().filter(|state| state.columns.is_none()).count();
    let done = tasks.len() - failed - left;
    let _ = writeln!(text, "{}: {done} done, {failed} failed, {left} not done", volumes(tasks));
    Some(text)
}

/// Writes the report of a run of several tasks that is not over: it may end at any time.
///
/// # Errors
/// When it cannot be written.
pub fn write_report() -> anyhow::Result<()> {
    // One at a time: a later report must not be replaced by an earlier one.
    if let Some(SoFar { tasks, states, report: Some(report) }) = &*so_far()
        && tasks.len() > 1
    {
        super::write_json(report, &states.iter().map(|state| &state.entry).collect::<Vec<_>>())?;
    }
    Ok(())
}

fn so_far() -> MutexGuard<'static, Option<SoFar>> {
    SO_FAR.lock().unwrap_or_else(PoisonError::into_inner)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn named(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_named_after_inputs() {
        for (input, name) in [
            ("engine.nrrd", "engine.vxr"),
            ("a/b/head.nii.gz", "head.vxr"),
            ("HEAD.NII.GZ", "HEAD.vxr"),
            ("ct.raw.gz", "ct.raw.vxr"),
            ("scan.2.mha", "scan.2.vxr"),
            ("plain", "plain.vxr"),
        ] {
            assert_eq!(packed_name(Path::new(input)), Some(name.into()), "{input}");
        }
        assert_eq!(packed_name(Path::new("..")), None);
    }

    #[test]
    fn an_interrupted_run_has_a_table_and_a_report_of_what_was_done() {
        let inputs = ["a.nrrd", "b.nrrd", "c.nrrd", "d.nrrd", "e.nrrd"].map(PathBuf::from);
        let folder = tempfile::tempdir().expect("a folder");
        let tasks = tasks(&inputs, folder.path()).expect("distinct names");
        begin(&tasks[..1], None, &[]);
        assert_eq!(table_so_far(), None, "one volume needs no table");
        let report = folder.path().join("r.json");
        // The file of one is there, that of another is not, and that of a third is another one.
        fs::write(&tasks[1].output, [0; 5]).expect("writes");
        fs::write(&tasks[4].output, [0; 6]).expect("writes");
        let before = ["b.nrrd", "d.nrrd", "e.nrrd"].map(|input| json!({ "input": input, "file_bytes": 5 }));
        begin(&tasks, Some(&report), &before);
        note(&tasks[2], &Ok(Done::Skipped(None))).expect("is written");
        note(&tasks[0], &Err(anyhow!("is\ndamaged"))).expect("is written");
        let table = table_so_far().expect("there are several");
        let lines: Vec<&str> = table.lines().skip(1).collect();
        let expected = [
            "a.nrrd  error: is damaged",
            "b.nrrd  not done",
            "c.nrrd  was there already",
            "d.nrrd  not done",
            "e.nrrd  not done",
            "5 volumes: 1 done, 1 failed, 3 not done",
        ];
        assert_eq!(lines, expected);
        let expected = json!([
            { "input": "a.nrrd", "error": "is\ndamaged" },
            before[0],
            { "input": "c.nrrd", "skipped": true },
            { "input": "d.nrrd", "interrupted": true },
            { "input": "e.nrrd", "interrupted": true },
        ]);
        assert_eq!(serde_json::from_slice::<Value>(&fs::read(report).expect("is there")).expect("is JSON"), expected);
    }

    #[test]
    fn every_task_is_done_once_and_in_order() {
        let inputs: Vec<PathBuf> = (0..20).map(|index| format!("{index}.nrrd").into()).collect();
        let tasks = tasks(&inputs, Path::new("folder")).expect("distinct names");
        for jobs in [1, 3, 20] {
            let told = AtomicUsize::new(0);
            let work = |task: &Task| match task.input.to_str() {
                Some("7.nrrd") => panic!("as a fault would"),
                name => Err(anyhow!("{}: bad", name.unwrap_or_default())),
            };
            let outcomes = run(&tasks, jobs, work, |_, _| _ = told.fetch_add(1, Ordering::Relaxed));
            assert_eq!((outcomes.len(), told.into_inner()), (20, 20));
            for (index, outcome) in outcomes.iter().enumerate() {
                let said = outcome.as_ref().expect_err("all fail").to_string();
                assert!(
                    said.starts_with(&format!("{index}.nrrd: ")) && said.contains("fault") == (index == 7),
                    "{said}"
                );
            }
        }
    }
}
