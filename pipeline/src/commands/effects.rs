//! `mammotwin effects`: what a model may lack.

use crate::cli::EffectsArguments;
use mammotwin_data::Failure;
use mammotwin_stages::{
    discover::ARTEFACTS,
    effects::{EFFECTS, Effect},
    force_curve::library::CURVE_EFFECTS,
    image_chain::library::IMAGE_EFFECTS,
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
                "sentence": effect.sentence,
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
        let images = IMAGE_EFFECTS.each_ref().map(|effect| {
            json!({
                "data": "mammogram",
                "name": effect.name,
                "sentence": effect.sentence,
                "amplitude": effect.meaning,
                "unit": effect.unit,
                "range": effect.range,
                "signature": effect.signature,
            })
        });
        let artefacts = ARTEFACTS.each_ref().map(|artefact| {
            json!({
                "data": "artefact",
                "name": artefact.name,
                "sentence": artefact.sentence,
                "treatment": artefact.treatment,
            })
        });
        let all = poses.into_iter().chain(curves).chain(images).chain(artefacts);
        tell!("{:#}", json!(all.collect::<Vec<_>>()));
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
        tell!("    told apart {}", effect.separated_by);
        tell!("    in reports {}\n", effect.sentence);
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
    tell!("Effects of the image chain are asked for by mammotwin study image-chain.\n");
    for effect in &IMAGE_EFFECTS {
        let [least, greatest] = effect.range;
        let unit = if effect.unit == "1" { "" } else { effect.unit };
        tell!("{}\n    {}", effect.name, effect.sentence);
        tell!("    amplitude  {}: {least} to {greatest} {unit}", effect.meaning);
        tell!("    shows as   {}\n", effect.signature);
    }
    tell!("Errors of the measurement, which are never called physics:\n");
    for artefact in &ARTEFACTS {
        tell!("{}\n    {}", artefact.name, artefact.sentence);
        tell!("    treated    {}\n", artefact.treatment);
    }
    Ok(())
}
