//! `mammotwin effects`: what a model may lack.

use crate::cli::EffectsArguments;
use mammotwin_data::Failure;
use mammotwin_stages::{
    effects::{EFFECTS, Effect},
    force_curve::library::CURVE_EFFECTS,
};
use serde_json::json;

/// The effects of these names, in the order of the library; all of them without a name.
pub fn library(names: &[String]) -> Result<Vec<&'static Effect>, Failure> {
    if let Some(name) = names.iter().find(|name| Effect::named(name).is_none()) {
        return Err(Failure::Usage(format!(
            "--effects {name}: no such effect of the poses; `mammotwin effects` lists them"
        )));
    }
    let wanted = |effect: &&Effect| names.is_empty() || names.iter().any(|n| n == effect.name);
    Ok(EFFECTS.into_iter().filter(wanted).collect())
}

/// Prints the library of effects.
pub fn effects(arguments: &EffectsArguments) -> Result<(), Failure> {
    if arguments.json {
        let poses = EFFECTS.map(|effect| {
            json!({
                "data": "poses",
                "name": effect.name,
                "title": effect.title,
                "place": effect.place,
                "amplitude": effect.amplitude.meaning,
                "unit": effect.amplitude.unit,
                "range": effect.amplitude.range,
                "signature": effect.signature,
                "confused_with": effect.confused_with,
                "separated_by": effect.separated_by,
            })
        });
        let curves = CURVE_EFFECTS.map(|effect| {
            json!({
                "data": "force_curve",
                "name": effect.name,
                "title": effect.title,
                "place": effect.place,
                "amplitude": effect.meaning,
                "unit": effect.unit,
                "keys": effect.keys,
                "signature": effect.signature,
                "confused_with": effect.confused_with,
                "separated_by": effect.separated_by,
            })
        });
        tell!("{:#}", json!(poses.into_iter().chain(curves).collect::<Vec<_>>()));
        return Ok(());
    }
    tell!("Switch an effect on with its amplitude, e.g. [model.effects] limit_chain = 0.5\n");
    for effect in EFFECTS {
        let amplitude = &effect.amplitude;
        let [least, greatest] = amplitude.range;
        tell!("{}\n    {}", effect.name, effect.title);
        tell!("    where      {}", effect.place);
        tell!(
            "    amplitude  {}: {least} to {greatest} {}",
            amplitude.meaning,
            if amplitude.unit == "1" { "" } else { amplitude.unit }
        );
        tell!("    shows as   {}", effect.signature);
        tell!("    like       {}", effect.confused_with.join(", "));
        tell!("    told apart {}\n", effect.separated_by);
    }
    tell!(
        "Effects of the compression need a record of force and thickness (mammotwin study force-curve), and \
         are switched on in [compress]; ranges depend on the study.\n"
    );
    for effect in CURVE_EFFECTS {
        tell!("{}\n    {}", effect.name, effect.title);
        tell!("    where      {}", effect.place);
        let unit = if effect.unit == "1" { "" } else { effect.unit };
        tell!("    amplitude  {} {unit}", effect.meaning);
        tell!("    keys       {}", effect.keys);
        tell!("    shows as   {}", effect.signature);
        tell!("    like       {}", effect.confused_with.join(", "));
        tell!("    told apart {}\n", effect.separated_by);
    }
    Ok(())
}
