//! How long-running code says where it is, without knowing who listens.

/// Receives progress from a stage. Calls are cheap and may come from any thread.
pub trait Progress: Sync {
    /// `fraction` of the stage done, in 0..=1, and what is being done now.
    fn report(&self, fraction: f64, doing: &str);
}

/// Nobody listens.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _fraction: f64, _doing: &str) {}
}

/// The part of a larger task: maps 0..=1 to `from..=to` of `whole`.
pub struct Part<'a> {
    /// Where the larger task reports to.
    pub whole: &'a dyn Progress,
    /// Fraction of the whole at which the part begins.
    pub from: f64,
    /// Fraction of the whole at which the part ends.
    pub to: f64,
}

impl Progress for Part<'_> {
    fn report(&self, fraction: f64, doing: &str) {
        self.whole.report(self.from + (self.to - self.from) * fraction.clamp(0.0, 1.0), doing);
    }
}
