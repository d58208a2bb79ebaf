//! What is said on standard error while volumes are prepared: bars with an estimate of the time left, lines, or JSON.

use std::io::IsTerminal;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use voxrole_preprocess::console::tell;
use voxrole_preprocess::progress::Progress;
use voxrole_preprocess::report::Report;

use super::args::ProgressArg;
use super::batch::Tally;
use super::progress_lines::{Event, JsonLines, TextLines};

/// Whether everything on standard error is JSON.
static SAYS_JSON: AtomicBool = AtomicBool::new(false);

/// Says something from wherever the program ends.
pub fn say_last(message: &str) {
    if SAYS_JSON.load(Ordering::Relaxed) {
        Event::Error { input: None, message }.write();
    } else {
        // Below a bar that may be there.
        tell(format!("\nvoxrole: {message}"));
    }
}

/// Tells of the inputs of one command.
pub struct Terminal {
    form: Form,
    /// Whether there are several inputs, so that each line has to say which.
    names_inputs: bool,
}

enum Form {
    Bars(MultiProgress),
    Lines,
    Json,
}

impl Terminal {
    /// In the form that was asked for; else bars on a terminal and lines elsewhere.
    pub fn new(form: Option<ProgressArg>, names_inputs: bool) -> Self {
        let form = match form {
            Some(ProgressArg::Json) => Form::Json,
            Some(ProgressArg::Lines) => Form::Lines,
            None if !std::io::stderr().is_terminal() => Form::Lines,
            Some(ProgressArg::Bar) | None => Form::Bars(MultiProgress::new()),
        };
        SAYS_JSON.store(matches!(form, Form::Json), Ordering::Relaxed);
        Self { form, names_inputs }
    }

    /// Whether every line is a JSON object.
    pub fn is_json(&self) -> bool {
        matches!(self.form, Form::Json)
    }

    /// What shows the stages of one input, until it is dropped.
    pub fn progress(&self, input: &Path) -> Box<dyn Progress> {
        match &self.form {
            Form::Bars(bars) => Box::new(Bar::new(bars, &self.prefix(input))),
            Form::Lines => Box::new(TextLines { prefix: self.prefix(input) }),
            Form::Json => Box::new(JsonLines::new(input.to_string_lossy().into_owned())),
        }
    }

    /// Something worth knowing about how an input was read.
    pub fn note(&self, input: &Path, message: &str) {
        let name = input.to_string_lossy();
        self.say(&Event::Note { input: &name, message }, || format!("voxrole: {}{message}", self.prefix(input)));
    }

    /// An input is prepared.
    pub fn done(&self, input: &Path, output: &Path, report: &Report) {
        let (name, output) = (input.to_string_lossy(), output.to_string_lossy());
        if let Some(message) = &report.warning {
            self.say(&Event::Warning { input: &name, message }, || {
                format!("voxrole: warning: {}{message}", self.prefix(input))
            });
        }
        let (seconds, bytes) = (report.seconds, report.file_bytes);
        match &self.form {
            Form::Json => Event::Done { input: &name, seconds, output: &output, bytes }.write(),
            Form::Lines if self.names_inputs => tell(format!("voxrole: {}done in {seconds:.2} s", self.prefix(input))),
            Form::Lines | Form::Bars(_) => {}
        }
    }

    /// An input's packed file was there already.
    pub fn skipped(&self, input: &Path, output: &Path) {
        let (input, output) = (input.to_string_lossy(), output.to_string_lossy());
        self.say(&Event::Skipped { input: &input, output: &output }, || {
            format!("voxrole: {output} is there already; {input} is left out")
        });
    }

    /// An input failed; without one, the command did.
    pub fn error(&self, input: Option<&Path>, error: &anyhow::Error) {
        // The alternate form is the whole chain of causes.
        let message = format!("{error:#}");
        let input = input.map(Path::to_string_lossy);
        self.say(&Event::Error { input: input.as_deref(), message: &message }, || format!("voxrole: {message}"));
    }

    /// All of several inputs are done with.
    pub fn summary(&self, tally: &Tally) {
        if self.is_json() {
            Event::Summary { succeeded: tally.prepared, skipped: tally.skipped, failed: tally.failed }.write();
        }
    }

    fn say(&self, event: &Event<'_>, text: impl FnOnce() -> String) {
        match &self.form {
            Form::Bars(bars) => bars.suspend(|| tell(text())),
            Form::Lines => tell(text()),
            Form::Json => event.write(),
        }
    }

    fn prefix(&self, input: &Path) -> String {
        let name = input.file_name().unwrap_or_default().to_string_lossy();
        if self.names_inputs { format!("{name}: ") } else { String::new() }
    }
}

/// The bar of one input, which shows its current stage.
struct Bar(ProgressBar);

impl Bar {
    fn new(bars: &MultiProgress, prefix: &str) -> Self {
        let bar = bars.add(ProgressBar::new(1).with_prefix(prefix.to_owned()));
        let template = "{prefix}{msg:>26} [{bar:30}] {pos}/{len}, {elapsed} so far, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self(bar)
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &'static str, steps: u64) {
        self.0.reset();
        self.0.set_length(steps);
        self.0.set_message(stage);
    }

    fn step(&self) {
        self.0.inc(1);
    }

    fn note(&self, message: &str) {
        self.0.suspend(|| tell(format!("voxrole: {}{message}", self.0.prefix())));
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
