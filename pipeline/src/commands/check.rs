//! `mammotwin check`: looks at the study and its files before any long work.

use super::open;
use crate::{
    cli::ReadArguments,
    plausible::{Finding, Weight, findings},
};
use mammotwin_data::Failure;

/// Prints what was found; fails when something is wrong.
pub fn check(arguments: &ReadArguments) -> Result<(), Failure> {
    let opened = open(&arguments.study)?;
    let found = findings(&opened.study, &opened.base);
    if arguments.json {
        tell!("{:#}", serde_json::json!(found));
    } else {
        tell!("{}", as_table(&found));
    }
    opened.refuse_wrong(&found)
}

fn as_table(found: &[Finding]) -> String {
    let width = found.iter().map(|finding| finding.key.len()).max().unwrap_or(0);
    let line = |finding: &Finding| {
        let word = match finding.weight {
            Weight::Good => "good",
            Weight::Warning => "warning",
            Weight::Wrong => "WRONG",
        };
        format!("{:width$}  {word:7}  {}", finding.key, finding.text)
    };
    found.iter().map(line).collect::<Vec<_>>().join("\n")
}
