//! Shows a run on standard error: a bar for the stage at work, or plain lines without a terminal.

use crate::{cli::one_line, commands::status::size};
use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};
use mammotwin_data::{
    progress::Progress,
    store::{Event, Listener, Record},
};
use std::{
    fmt::Write,
    io::IsTerminal,
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// Whether only failures are shown.
static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on nothing but failures and answers is shown.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// What a run tells on standard output, unless it is quiet.
pub fn say(text: &str) {
    if !QUIET.load(Ordering::Relaxed) {
        tell!("{text}");
    }
}

/// What a run tells on standard error, unless it is quiet.
fn tell(text: &str) {
    if !QUIET.load(Ordering::Relaxed) {
        eprintln!("{text}");
    }
}

/// Time left, once there is something to tell it from.
fn left(state: &ProgressState, out: &mut dyn Write) {
    if state.pos() > 0 {
        // Writing to a string cannot fail.
        let _ = write!(out, ", {:#} left", HumanDuration(state.eta()));
    }
}

/// Bar steps from begin to end of a stage.
const STEPS: f64 = 1000.0;

/// Shows a run on standard error.
#[derive(Debug)]
pub struct Display {
    terminal: bool,
    bar: Mutex<Option<ProgressBar>>,
}

impl Default for Display {
    fn default() -> Self {
        Self::new()
    }
}

impl Display {
    /// A display that looks whether standard error is a terminal.
    pub fn new() -> Self {
        Self { terminal: std::io::stderr().is_terminal(), bar: Mutex::new(None) }
    }

    fn bar(&self) -> std::sync::MutexGuard<'_, Option<ProgressBar>> {
        self.bar.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn line(&self, text: &str) {
        match &*self.bar() {
            Some(bar) => bar.suspend(|| tell(text)),
            None => tell(text),
        }
    }

    fn begin(&self, instance: &str, number: usize, total: usize) {
        if !self.terminal {
            tell(&format!("[{number}/{total}] {instance} ..."));
            return;
        }
        if QUIET.load(Ordering::Relaxed) {
            return;
        }
        let style = ProgressStyle::with_template("{prefix} {bar:24} {elapsed}{left}  {wide_msg}")
            .expect("the template is a constant")
            .with_key("left", left);
        let bar =
            ProgressBar::new(STEPS as u64).with_prefix(format!("[{number}/{total}] {instance}"));
        bar.set_style(style);
        bar.enable_steady_tick(Duration::from_millis(200));
        *self.bar() = Some(bar);
    }

    fn end(&self) {
        if let Some(bar) = self.bar().take() {
            bar.finish_and_clear();
        }
    }
}

impl Listener for Display {
    fn on(&self, event: &Event<'_>) {
        log(event);
        match event {
            Event::Started { instance, number, total } => self.begin(instance, *number, *total),
            Event::Progress { fraction, doing, .. } => {
                if let Some(bar) = &*self.bar() {
                    bar.set_position((fraction.clamp(0.0, 1.0) * STEPS) as u64);
                    bar.set_message((*doing).to_owned());
                }
            }
            Event::Computed { instance, record, differs } => {
                self.end();
                tell(&done(instance, record));
                if *differs {
                    let text = "warning: other bytes than the last time from equal inputs";
                    tell(&format!("{instance}: {text}"));
                }
            }
            Event::Failed { .. } => self.end(),
            Event::Reused { .. } => {}
            Event::Damaged { what, why } => {
                self.line(&format!("{what}: {}: computed anew", one_line(why)));
            }
            Event::Warned { instance, warning } => self.line(&format!("{instance}: {warning}")),
            Event::Waiting { instance, holder } => {
                self.line(&format!("{instance}: waiting for {holder}"));
            }
            Event::Edited { instance, path, inputs_changed } => {
                self.line(&edited(instance, path, *inputs_changed));
            }
            Event::Kept { path } => {
                let path = path.display();
                self.line(&format!(
                    "{path}: changed by hand, left as it is; delete it to get ours"
                ));
            }
        }
    }
}

/// Shows one piece of work that is no stage.
#[derive(Debug)]
pub struct Task {
    display: Display,
    name: &'static str,
}

impl Task {
    /// Begins to show it.
    pub fn new(name: &'static str) -> Self {
        let display = Display::new();
        display.begin(name, 1, 1);
        Self { display, name }
    }
}

impl Progress for Task {
    fn report(&self, fraction: f64, doing: &str) {
        self.display.on(&Event::Progress { instance: self.name, fraction, doing });
    }
}

impl Drop for Task {
    fn drop(&mut self) {
        self.display.end();
    }
}

/// The same for the log.
fn log(event: &Event<'_>) {
    match event {
        Event::Started { instance, number, total } => {
            tracing::info!(instance, number, total, "started");
        }
        Event::Progress { instance, fraction, doing } => {
            tracing::debug!(instance, fraction, doing, "progress");
        }
        Event::Computed { instance, record, differs } => {
            let (wall_ms, peak_memory_bytes) = (record.wall_ms, record.peak_memory_bytes);
            tracing::info!(instance, wall_ms, peak_memory_bytes, differs, "computed");
        }
        Event::Failed { instance, .. } => tracing::error!(instance, "failed"),
        Event::Reused { instance, .. } => tracing::info!(instance, "reused"),
        Event::Damaged { what, why } => tracing::warn!(what, why = one_line(why), "damaged"),
        Event::Warned { instance, warning } => tracing::warn!(instance, warning, "warned"),
        Event::Waiting { instance, holder } => {
            tracing::info!(instance, holder = %holder, "waiting");
        }
        Event::Edited { instance, inputs_changed, .. } => {
            tracing::info!(instance, inputs_changed, "edited by hand");
        }
        Event::Kept { .. } => tracing::info!("a file that was changed by hand is kept"),
    }
}

fn done(instance: &str, record: &Record) -> String {
    let (seconds, memory) = (record.wall_ms as f64 / 1000.0, size(record.peak_memory_bytes));
    format!("{instance}: {seconds:.1} s, {memory}")
}

fn edited(instance: &str, path: &Path, inputs_changed: bool) -> String {
    let since = if inputs_changed { "; what it was made from has changed since" } else { "" };
    format!("{instance}: {} was edited by hand and is used{since}", path.display())
}
