//! `mammotwin verify` and `mammotwin gc`: the care of a store.

use super::{open, run::plan, status::size};
use crate::cli::{GcArguments, StudyArguments};
use mammotwin_data::{
    Failure,
    store::{self, Options},
};

/// Reads all results again; exits with 65 when one is damaged.
pub fn verify(arguments: &StudyArguments) -> Result<(), Failure> {
    let opened = open(arguments)?;
    let (count, damages) = store::verify(&opened.store);
    for damage in &damages {
        tell!("{}: {}", damage.folder.display(), damage.why);
    }
    if damages.is_empty() {
        tell!("{count} results, all as they were stored");
        return Ok(());
    }
    let text =
        format!("{} of {count} results are damaged; `run` computes them anew", damages.len());
    Err(Failure::BadInput(text))
}

/// Drops results that no current key needs.
pub fn gc(arguments: &GcArguments) -> Result<(), Failure> {
    let opened = open(&arguments.study)?;
    let entries = plan(&opened, &Options::default())?.entries;
    let (word, rubbish) = if arguments.dry_run {
        ("would be dropped", store::rubbish(&opened.store, &entries))
    } else {
        ("dropped", store::collect(&opened.store, &entries)?)
    };
    for item in &rubbish {
        tell!("{:>9}  {}", size(item.bytes), item.path.display());
    }
    let total = rubbish.iter().map(|item| item.bytes).sum();
    tell!("{} results, {} {word}", rubbish.len(), size(total));
    Ok(())
}
