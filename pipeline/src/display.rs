//! Shows a run on standard error: a bar for the stage at work, or plain lines without a terminal.

use crate::{cli::one_line, commands::status::size};
use indicatif::{ProgressBar, ProgressStyle};
use mammotwin_data::{
    progress::Progress,
    store::{Event, Listener, Record},
};
use std::{
    io::IsTerminal,
    path::Path,
    sync::{Mutex, PoisonError},
    time::Duration,
};

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
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None => eprintln!("{text}"),
        }
    }

    fn begin(&self, instance: &str, number: usize, total: usize) {
        if !self.terminal {
            eprintln!("[{number}/{total}] {instance} ...");
            return;
        }
        let style =
            ProgressStyle::with_template("{prefix} {bar:24} {elapsed}, {eta} left  {wide_msg}");
        let bar =
            ProgressBar::new(STEPS as u64).with_prefix(format!("[{number}/{total}] {instance}"));
        bar.set_style(style.expect("the template is a constant"));
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
                eprintln!("{}", done(instance, record));
                if *differs {
                    eprintln!(
                        "{instance}: warning: other bytes than the last time from equal inputs"
                    );
                }
            }
            Event::Failed { .. } => self.end(),
            Event::Reused { .. } => {}
            Event::Damaged { what, why } => {
                self.line(&format!("{what}: {}: computed anew", one_line(why)));
            }
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

fn done(instance: &str, record: &Record) -> String {
    let (seconds, memory) = (record.wall_ms as f64 / 1000.0, size(record.peak_memory_bytes));
    format!("{instance}: {seconds:.1} s, {memory}")
}

fn edited(instance: &str, path: &Path, inputs_changed: bool) -> String {
    let since = if inputs_changed { "; what it was made from has changed since" } else { "" };
    format!("{instance}: {} was edited by hand and is used{since}", path.display())
}
