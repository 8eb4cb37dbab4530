//! `mammotwin completions` and `mammotwin man`: what shells and `man` know of the commands.

use crate::cli::{Arguments, CompletionArguments, ManArguments};
use clap::CommandFactory;
use mammotwin_data::Failure;
use std::{fs, io::Write};

/// Prints the completions of a shell.
pub fn completions(arguments: &CompletionArguments) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut Arguments::command(), "mammotwin", &mut text);
    print(&text)
}

/// Prints the manual page, or writes those of all commands.
pub fn pages(arguments: &ManArguments) -> Result<(), Failure> {
    let command = Arguments::command();
    match &arguments.out {
        Some(folder) => {
            let refuse = |cause| Failure::io(folder, cause);
            fs::create_dir_all(folder).map_err(refuse)?;
            clap_mangen::generate_to(command, folder).map_err(refuse)
        }
        None => {
            let mut text = Vec::new();
            let made = clap_mangen::Man::new(command).render(&mut text);
            made.map_err(|cause| Failure::io("standard output", cause))?;
            print(&text)
        }
    }
}

fn print(text: &[u8]) -> Result<(), Failure> {
    let done = std::io::stdout().write_all(text);
    done.map_err(|cause| Failure::io("standard output", cause))
}
