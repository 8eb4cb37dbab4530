//! The program `mammotwin`.

use clap::Parser;
use mammotwin::{cli, commands};
use mammotwin_data::Failure;
use std::{
    env,
    fs::File,
    io::{self, IsTerminal},
    process::ExitCode,
    sync::Mutex,
};
use tracing_subscriber::filter::LevelFilter;

/// Level of the log: `error`, `warn`, `info`, `debug` or `trace`. On standard error there is none when
/// it is not set; a log file gets `info` then.
const LOG: &str = "MAMMOTWIN_LOG";
/// `always` and `never` decide whether the line of the study is shown under a refusal; else it is shown
/// on terminals.
const EXCERPT: &str = "MAMMOTWIN_EXCERPT";

fn main() -> ExitCode {
    let arguments = cli::Arguments::parse();
    let done = start_log(&arguments).and_then(|()| commands::dispatch(&arguments));
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let text = cli::one_line(&failure.to_string());
            tracing::error!("{text}");
            refuse(&text, failure.excerpt());
            ExitCode::from(failure.exit_code())
        }
    }
}

/// One line on standard error; people at a terminal also see the line of the study.
fn refuse(text: &str, excerpt: Option<&str>) {
    let terminal = io::stderr().is_terminal();
    let shown = match env::var(EXCERPT).as_deref() {
        Ok("always") => true,
        Ok("never") => false,
        _ => terminal,
    };
    let colored = terminal && env::var_os("NO_COLOR").is_none();
    let [red, bold, plain] = if colored { ["\x1b[31m", "\x1b[1m", "\x1b[0m"] } else { [""; 3] };
    eprintln!("{bold}mammotwin:{plain} {text}");
    for line in excerpt.filter(|_| shown).into_iter().flat_map(str::lines) {
        let marks = line.trim_start_matches([' ', '|', '\t']);
        if !marks.is_empty() && marks.chars().all(|c| c == '^') {
            eprintln!("{}{red}{marks}{plain}", &line[..line.len() - marks.len()]);
        } else {
            eprintln!("{line}");
        }
    }
}

fn start_log(arguments: &cli::Arguments) -> Result<(), Failure> {
    let level: Option<LevelFilter> = env::var(LOG).ok().and_then(|level| level.parse().ok());
    let log = tracing_subscriber::fmt().with_ansi(false);
    match &arguments.log {
        Some(path) => {
            let opened = File::options().create(true).append(true).open(path);
            let file = opened.map_err(|cause| Failure::io(path, cause))?;
            let level = level.unwrap_or(LevelFilter::INFO);
            log.with_max_level(level).with_writer(Mutex::new(file)).init();
        }
        None => {
            let level = level.unwrap_or(LevelFilter::OFF);
            log.with_max_level(level).with_writer(io::stderr).init();
        }
    }
    Ok(())
}
