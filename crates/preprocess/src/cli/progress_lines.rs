//! Progress as lines: text for people, or one JSON object per line for schedulers.

use std::io::Write;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::progress::Progress;

/// Names each stage.
pub struct TextLines {
    /// What stands before the stage.
    pub prefix: String,
}

impl Progress for TextLines {
    fn begin(&self, stage: &'static str, _: u64) {
        tell(format!("voxrole: {}{stage}", self.prefix));
    }

    fn step(&self) {}

    fn note(&self, message: &str) {
        tell(format!("voxrole: {}{message}", self.prefix));
    }
}

/// What `--progress json` tells; inputs and outputs are paths as given, with U+FFFD for what is not Unicode.
#[derive(Serialize)]
#[serde(tag = "event", rename_all = "lowercase")]
pub enum Event<'a> {
    Begin {
        input: &'a str,
        stage: &'static str,
        steps: u64,
    },
    Step {
        input: &'a str,
        stage: &'static str,
        done: u64,
        steps: u64,
    },
    Done {
        input: &'a str,
        seconds: f64,
        output: &'a str,
        bytes: u64,
    },
    /// The output was there already, and was to be left alone.
    Skipped {
        input: &'a str,
        output: &'a str,
    },
    /// How an input was read, or that an earlier run is gone on with.
    Note {
        input: &'a str,
        message: &'a str,
    },
    Warning {
        input: &'a str,
        message: &'a str,
    },
    /// Without an input it is the command that was refused.
    Error {
        #[serde(skip_serializing_if = "Option::is_none")]
        input: Option<&'a str>,
        message: &'a str,
    },
    Summary {
        succeeded: usize,
        skipped: usize,
        failed: usize,
    },
}

impl Event<'_> {
    /// Writes the event as one line on standard error. That nobody reads on is no reason to end a run.
    pub fn write(&self) {
        if let Ok(mut line) = serde_json::to_vec(self) {
            line.push(b'\n');
            let _ = std::io::stderr().write_all(&line);
        }
    }
}

/// Time between two lines about the steps of a stage.
const BETWEEN_STEPS: Duration = Duration::from_millis(500);

/// Tells the stages and steps of one input as JSON.
pub struct JsonLines {
    input: String,
    stage: Mutex<Stage>,
}

struct Stage {
    name: &'static str,
    steps: u64,
    done: u64,
    told: Instant,
}

impl JsonLines {
    /// About `input`.
    pub fn new(input: String) -> Self {
        Self { input, stage: Mutex::new(Stage { name: "", steps: 0, done: 0, told: Instant::now() }) }
    }
}

impl Progress for JsonLines {
    fn begin(&self, stage: &'static str, steps: u64) {
        let mut current = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        *current = Stage { name: stage, steps, done: 0, told: Instant::now() };
        Event::Begin { input: &self.input, stage, steps }.write();
    }

    fn step(&self) {
        // Held while writing, so that lines come in the order of the steps.
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        stage.done += 1;
        if stage.done == stage.steps || stage.told.elapsed() >= BETWEEN_STEPS {
            stage.told = Instant::now();
            Event::Step { input: &self.input, stage: stage.name, done: stage.done, steps: stage.steps }.write();
        }
    }

    fn note(&self, message: &str) {
        Event::Note { input: &self.input, message }.write();
    }
}
