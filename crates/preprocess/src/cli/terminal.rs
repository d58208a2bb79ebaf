//! Progress on the terminal: a bar with an estimate of the time left, or plain lines where there is no terminal.

use std::io::IsTerminal;
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};
use voxrole_preprocess::progress::Progress;

/// Shows progress on standard error.
pub struct TerminalProgress {
    bar: Mutex<Option<ProgressBar>>,
    is_terminal: bool,
}

impl TerminalProgress {
    /// Looks whether standard error is a terminal.
    pub fn new() -> Self {
        Self { bar: Mutex::new(None), is_terminal: std::io::stderr().is_terminal() }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = self.lock().take() {
            bar.finish_and_clear();
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<ProgressBar>> {
        // A panic elsewhere leaves a bar that can still be drawn.
        self.bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Progress for TerminalProgress {
    fn begin(&self, stage: &'static str, steps: u64) {
        self.finish();
        if !self.is_terminal {
            eprintln!("voxrole: {stage}");
            return;
        }
        let bar = ProgressBar::new(steps).with_message(stage);
        let template = "{msg:>26} [{bar:30}] {pos}/{len}, {elapsed} so far, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        *self.lock() = Some(bar);
    }

    fn step(&self) {
        if let Some(bar) = &*self.lock() {
            bar.inc(1);
        }
    }
}
