//! How a long run tells where it is.

/// Told of stages and of steps inside them, from any thread.
pub trait Progress: Sync {
    /// A stage of `steps` equal steps begins; the one before it has ended.
    fn begin(&self, stage: &'static str, steps: u64);
    /// One more step of the current stage is done.
    fn step(&self);
    /// Something worth knowing about how the run goes.
    fn note(&self, _message: &str) {}
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &'static str, _: u64) {}
    fn step(&self) {}
}
