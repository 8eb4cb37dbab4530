//! How long-running code says where it is, without knowing who listens.

/// Receives progress from a stage. Calls are cheap and may come from any thread.
pub trait Progress: Sync {
    /// `fraction` of the stage done, in 0..=1, and what is being done now.
    fn report(&self, fraction: f64, doing: &str);

    /// A warning that belongs to the result: the store keeps it with that. Texts must name no file and no person, and
    /// come in the same order for equal inputs.
    fn warn(&self, _warning: &str) {}

    /// A number that says how far the result is to be trusted, kept likewise where it is finite.
    fn note(&self, _name: &str, _value: f64) {}
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

    fn warn(&self, warning: &str) {
        self.whole.warn(warning);
    }

    fn note(&self, name: &str, value: f64) {
        self.whole.note(name, value);
    }
}
