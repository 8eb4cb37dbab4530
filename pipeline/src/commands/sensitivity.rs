//! `mammotwin study sensitivity`: what the tissues do, and the error of the model over all moduli.

use super::{open, rising, write};
use crate::{
    cli::SensitivityArguments,
    display::Display,
    plausible::findings,
    sensitivity::{ErrorMap, errors, page, profiles, sweeps, thesis_sweeps, vary},
};
use mammotwin_data::{
    Failure,
    store::{self, Drive, Options, Stored},
};
use std::fs;

/// Computes what is not there and writes tables, figures and page.
pub fn sensitivity(arguments: &SensitivityArguments) -> Result<(), Failure> {
    let moduli = |option: &str, given: &[f64]| rising(option, given, [1e-3, 1e6]);
    let breast_kpa = moduli("--breast", &arguments.breast)?;
    let skins = moduli("--skin", &arguments.skin)?;
    let fascias = moduli("--fascia", &arguments.fascia)?;
    let every = |&fascia: &f64| skins.iter().map(move |&skin| [skin, fascia]);
    let rows = if arguments.no_map { Vec::new() } else { fascias.iter().flat_map(every).collect() };
    let map = ErrorMap { breast_kpa, rows };
    let swept = if arguments.no_sweeps { Vec::new() } else { thesis_sweeps() };
    let opened = open(&arguments.study)?;
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let display = Display::new();
    let options = Options::default();
    let drive =
        Drive { store: &opened.store, base: &opened.base, options: &options, listener: &display };
    let pass = store::execute(&drive, |run| vary(&opened.study, &swept, &map, run))?;
    drop(display);
    let swept = pass.outcome.sweeps.iter().map(Stored::load).collect::<Result<Vec<_>, _>>()?;
    let found = pass.outcome.rows.iter().map(Stored::load).collect::<Result<Vec<_>, _>>()?;
    let folder = opened.store.out.join("studies").join("sensitivity");
    fs::create_dir_all(&folder).map_err(|cause| Failure::io(&folder, cause))?;
    let (html, figures) = page(&opened.study, &swept, &map, &found);
    for (name, svg) in &figures {
        write(&folder.join(name), svg)?;
    }
    write(&folder.join("sweeps.csv"), sweeps(&swept))?;
    write(&folder.join("errors.csv"), errors(&map, &found))?;
    write(&folder.join("profiles.csv"), profiles::csv(&profiles::profiles(&map, &found)))?;
    write(&folder.join("sensitivity.html"), html)?;
    let points = found.iter().map(|row| row.0.len()).sum::<usize>();
    let failed = found.iter().flat_map(|row| &row.0).filter(|p| p.failed.is_some()).count();
    let computed = pass.entries.iter().filter(|entry| entry.computed).count();
    tell!("{computed} of {} stages computed", pass.entries.len());
    tell!("{points} sets of moduli, {failed} without an equilibrium");
    tell!("{}", folder.join("sensitivity.html").display());
    Ok(())
}
