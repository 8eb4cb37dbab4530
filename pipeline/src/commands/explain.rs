//! `mammotwin explain`: which field of a stage's key changed.

use super::{open, run::plan};
use crate::cli::ExplainArguments;
use mammotwin_data::{
    Failure,
    store::{self, Entry, Explanation, Options, State},
};

/// Prints why the instances of a stage are not fresh, or how they differ from the last time.
pub fn explain(arguments: &ExplainArguments) -> Result<(), Failure> {
    let opened = open(&arguments.study)?;
    let entries = plan(&opened, &Options::default())?.entries;
    let name = &arguments.stage;
    let named = |entry: &&Entry| entry.stage == *name || entry.instance == *name;
    let asked: Vec<_> = entries.iter().filter(named).collect();
    if asked.is_empty() {
        let known: Vec<_> = entries.iter().map(|entry| entry.instance.as_str()).collect();
        let text = format!("no stage {name:?} in this study; there are: {}", known.join(", "));
        return Err(Failure::Usage(text));
    }
    for entry in asked {
        tell!("{}", describe(&store::explain(&opened.store, entry)));
    }
    Ok(())
}

fn describe(explanation: &Explanation) -> String {
    let Explanation { instance, state, changes } = explanation;
    let fresh = *state == State::Fresh;
    let head = match state {
        State::Failed(why) => format!("{instance} failed: {why}"),
        State::Damaged(why) => format!("{instance} is damaged: {why}"),
        state => format!("{instance} is {state}"),
    };
    match changes.as_deref() {
        None if fresh => format!("{head}; there is no other result to compare with"),
        None => format!("{head}; it was never computed"),
        Some([]) => format!("{head}; its key is that of the last result"),
        Some(changes) => {
            let since = if fresh { "the result before" } else { "the last result" };
            let lines: Vec<_> = changes.iter().map(|change| format!("  {change}")).collect();
            format!("{head}; changed since {since}:\n{}", lines.join("\n"))
        }
    }
}
