//! Effects of the compression. An effect changes the compression of a study by an amplitude; amplitude zero is
//! the study itself. A new effect is one file here and one line in [`CURVE_EFFECTS`].

mod limit_chain;
mod paddle_elastic;
mod paddle_friction;
mod paddle_hinge;
mod paddle_offset;
mod prestress_gravity;
mod rate_stiffening;

use mammotwin_data::study::CompressPlan;

/// All of them, in the order in which they are listed.
pub const CURVE_EFFECTS: [&CurveEffect; 7] = [
    &paddle_offset::EFFECT,
    &paddle_hinge::EFFECT,
    &paddle_elastic::EFFECT,
    &paddle_friction::EFFECT,
    &prestress_gravity::EFFECT,
    &rate_stiffening::EFFECT,
    &limit_chain::EFFECT,
];

/// An effect of the compression: what it is to people, and what it does to the compression of a study.
#[derive(Debug)]
pub struct CurveEffect {
    /// Its word.
    pub name: &'static str,
    /// What people call it.
    pub title: &'static str,
    /// Where it acts.
    pub place: &'static str,
    /// What its amplitude says.
    pub meaning: &'static str,
    /// Unit of its amplitude.
    pub unit: &'static str,
    /// One sentence for the report.
    pub sentence: &'static str,
    /// What shows it.
    pub signature: &'static str,
    /// Effects that look alike.
    pub confused_with: &'static [&'static str],
    /// What measurement would tell them apart.
    pub separated_by: &'static str,
    /// Keys of the study that switch it on.
    pub keys: &'static str,
    /// Forces of a body that is `k` times as stiff, with an amplitude `a`, are `k` times those of the body itself
    /// with `a` times `k` to this power: exact for rigid paddles.
    pub scaling: i32,
    /// Plausible amplitudes, zero among them; `None` where a compression cannot have it.
    pub range: fn(&CompressPlan) -> Option<[f64; 2]>,
    /// Changes a compression by an amplitude.
    pub apply: fn(&mut CompressPlan, f64),
}

impl CurveEffect {
    /// The effect of a word.
    pub fn named(name: &str) -> Option<&'static Self> {
        CURVE_EFFECTS.into_iter().find(|effect| effect.name == name)
    }

    /// A compression with an amplitude of it.
    pub fn switched(&self, plan: &CompressPlan, amplitude: f64) -> CompressPlan {
        let mut with = plan.clone();
        if amplitude != 0.0 {
            (self.apply)(&mut with, amplitude);
        }
        with
    }
}
