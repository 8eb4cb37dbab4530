//! `mammotwin score`: a run against the truth of a digital volunteer.

use super::{open, run::plan};
use crate::{cli::ScoreArguments, estimates::estimates, score};
use mammotwin_data::{Failure, store::Options};
use serde_json::Value;

/// Prints how near a run came to the truth. Computes nothing: the run must be there.
pub fn score(arguments: &ScoreArguments) -> Result<(), Failure> {
    let opened = open(&arguments.study)?;
    let outcome = plan(&opened, &Options::default())?.outcome;
    let scores = score::score(&estimates(&outcome)?, &arguments.truth)?;
    if arguments.json {
        tell!("{scores:#}");
    } else {
        print("", &scores);
    }
    Ok(())
}

/// One line a number: `registration.prone.translation_mm  0.412`.
fn print(path: &str, value: &Value) {
    match value {
        Value::Object(members) => {
            for (name, member) in members {
                let dot = if path.is_empty() { "" } else { "." };
                print(&format!("{path}{dot}{name}"), member);
            }
        }
        leaf => match leaf.as_f64() {
            Some(number) => tell!("{path:45}  {number:.4}"),
            None => tell!("{path:45}  {leaf}"),
        },
    }
}
