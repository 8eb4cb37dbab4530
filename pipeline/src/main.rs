//! The program `mammotwin`.

use clap::Parser;
use mammotwin::{cli, commands};
use std::{env, io, process::ExitCode};
use tracing_subscriber::filter::LevelFilter;

/// Level of the log on standard error: `warn`, `info`, `debug` or `trace`; none when it is not set.
const LOG: &str = "MAMMOTWIN_LOG";

fn main() -> ExitCode {
    let level = env::var(LOG).ok().and_then(|level| level.parse().ok());
    tracing_subscriber::fmt()
        .with_max_level(level.unwrap_or(LevelFilter::OFF))
        .with_writer(io::stderr)
        .init();
    let arguments = cli::Arguments::parse();
    match commands::dispatch(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("mammotwin: {}", cli::one_line(&failure.to_string()));
            ExitCode::from(failure.exit_code())
        }
    }
}
