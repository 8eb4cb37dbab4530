//! The program `mammotwin`.

use clap::Parser;
use mammotwin::{cli, commands};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = cli::Arguments::parse();
    match commands::dispatch(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("mammotwin: {}", cli::one_line(&failure.to_string()));
            ExitCode::from(failure.exit_code())
        }
    }
}
