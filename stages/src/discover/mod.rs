//! Where simulation and measurement disagree, and which missing effect explains it.
//!
//! Residuals of the simulated poses are weighed with an [error budget](Budget). Each effect of the
//! [library](crate::effects) has a signature, the change of the residuals by a small amplitude;
//! a score test asks whether what survives of it, after the moduli took what they can, is in the
//! data. The best are fitted together with the moduli. A pose that the search never saw decides.

mod artefacts;
mod budget;
mod chance;
mod clusters;
mod course;
mod descent;
mod drift;
mod evidence;
mod held_out;
mod observe;
mod reference;
mod refit;
mod rest;
mod screen;
mod second;
mod signature;
#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests;
pub mod trial;
mod variation;
mod verdict;

pub use artefacts::{ARTEFACTS, Artefact};
pub use budget::{Budget, Nodes, RigidError};
pub(crate) use chance::by_chance;
pub use clusters::Cluster;
pub use course::{Bent, Course};
pub use drift::{Drift, PoseModuli};
pub use evidence::{Evidence, Gather};
pub(crate) use held_out::HELD_OUT;
pub use held_out::HeldOut;
pub(crate) use rest::RARE;
pub(crate) use screen::ALIKE_COSINE;
pub use screen::{Score, Screening};
pub use second::Second;
pub use signature::Signature;
pub(crate) use verdict::{ALIKE, FITTED};
pub use verdict::{Candidate, Judge, Verdict, VerdictName};

use crate::calibrate::{Experiment, Fit};
use mammotwin_data::{
    Failure,
    io::hdf5,
    mesh::Patch,
    progress::Progress,
    store::{Artifact, Stage},
    surface::TriMesh,
};
use observe::part;
use rayon::prelude::*;
use refit::{Fitted, Refit};
use serde::Serialize;
use std::path::Path;

/// Looks for a missing effect.
#[derive(Debug, Clone, Serialize)]
pub struct Discover {
    /// How the evidence was gathered.
    pub gather: Gather,
}

/// A pose before and after the effect is added.
#[derive(Debug, Clone)]
pub struct PoseGap {
    /// Its name.
    pub pose: String,
    /// Simulated skin (mm) without and with the effect, in the reference pose's frame; triangles of the
    /// corners of elements.
    pub skin: [TriMesh; 2],
    /// Its nodes that are weighed.
    pub active: Vec<u32>,
    /// Signed distances (mm) with refitted moduli, less what is known of the mesh's error.
    pub before_mm: Vec<f64>,
    /// The same with the effect that explains most.
    pub after_mm: Vec<f64>,
    /// Root mean squares (mm) after the best rigid motion: before, after, and of the errors.
    pub rms_mm: [f64; 3],
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Discovery {
    /// The answer.
    pub verdict: Verdict,
    /// All tests.
    pub screening: Screening,
    /// Moduli pose by pose.
    pub drift: Drift,
    /// The error budget.
    pub budget: Budget,
    /// Where residuals without an effect are larger than errors leave, moduli refitted.
    pub clusters: Vec<Cluster>,
    /// Before and after, in the order of the poses.
    pub gaps: Vec<PoseGap>,
}

impl Artifact for Discovery {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.put_json("verdict", &self.verdict, "the answer")?;
        file.put_json("screening", &self.screening, "score of each effect")?;
        file.put_json("drift", &self.drift, "moduli (kPa) that each seen pose asks for")?;
        file.put_json("budget", &self.budget, "error budget (mm)")?;
        file.put_json("clusters", &self.clusters, "places of significant residuals")?;
        let names: Vec<String> = self.gaps.iter().map(|gap| gap.pose.clone()).collect();
        file.put_texts("poses", &names, "poses that were compared")?;
        for gap in &self.gaps {
            let group = format!("gaps/{}", gap.pose);
            file.put_surface(&format!("{group}/skin_before"), &gap.skin[0])?;
            file.put_surface(&format!("{group}/skin_after"), &gap.skin[1])?;
            file.put(&format!("{group}/active"), &gap.active, "1", "weighed nodes")?;
            let name = format!("{group}/before");
            file.put(&name, &gap.before_mm, "mm", "signed distance without the effect")?;
            let name = format!("{group}/after");
            file.put(&name, &gap.after_mm, "mm", "signed distance with the effect")?;
            let name = format!("{group}/rms");
            file.put(&name, &gap.rms_mm, "mm", "before, after, floor; without rigid motion")?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let mut gaps = Vec::new();
        for pose in file.texts("poses")? {
            let group = format!("gaps/{pose}");
            let rms: Vec<f64> = file.get(&format!("{group}/rms"))?;
            let skin = |when: &str| file.surface(&format!("{group}/skin_{when}"));
            gaps.push(PoseGap {
                skin: [skin("before")?, skin("after")?],
                active: file.get(&format!("{group}/active"))?,
                before_mm: file.get(&format!("{group}/before"))?,
                after_mm: file.get(&format!("{group}/after"))?,
                rms_mm: std::array::from_fn(|n| rms.get(n).copied().unwrap_or(f64::NAN)),
                pose,
            });
        }
        Ok(Self {
            verdict: file.json("verdict")?,
            screening: file.json("screening")?,
            drift: file.json("drift")?,
            budget: file.json("budget")?,
            clusters: file.json("clusters")?,
            gaps,
        })
    }
}

/// The evidence, and all that it was gathered from.
type Input = (Evidence, evidence::Input);

impl Stage for Discover {
    const NAME: &'static str = "discover";
    const VERSION: u32 = 12;
    const METHODS: &'static str = "Residuals were weighed with the covariance of the errors of segmentation, registration, \
         chest wall and mesh. A score test asked for each effect of the library whether what the \
         moduli do not absorb of its signature is in the residuals; the threshold is the 99 % quantile \
         of the largest score about a systematic error of 0.8 standard deviations per mm of voxel, at least 1. The best effects were fitted together with the moduli, and judged on a \
         pose that the search did not see.";
    type Input = Input;
    type Output = Discovery;

    fn run(
        &self,
        (evidence, gathered): &Input,
        progress: &dyn Progress,
    ) -> Result<Discovery, Failure> {
        let judge = Judge::new(evidence)?;
        let screening = judge.screen(&evidence.residual);

        progress.report(0.1, "fits with the likeliest effects");
        let (_, _, mesh, calibration, ..) = gathered;
        let Gather { model, calibrate, .. } = &self.gather;
        let measured = self.gather.measured(gathered);
        let experiment = Experiment::new(mesh, model, calibrate, &measured)?;
        let moduli = evidence.moduli;
        let start = experiment.evaluate_as(&experiment.body, moduli, Some(&calibration.after))?;
        let refit = Refit {
            experiment: &experiment,
            evidence,
            whitener: &judge.whitener,
            seen: &judge.seen,
            plan: model,
            start: &start,
        };
        let likely = judge.likely(&screening);
        let wishes: Vec<_> = [None].into_iter().chain(likely.iter().copied().map(Some)).collect();
        let mut fits: Vec<(Fitted, Fit)> =
            wishes.into_par_iter().map(|effect| refit.run(effect)).collect();
        let (without, without_fit) = fits.remove(0);
        let (fitted, fits): (Vec<Fitted>, Vec<Fit>) = fits.into_iter().unzip();
        let with: Vec<(usize, Fitted)> = likely.into_iter().map(|(k, _)| k).zip(fitted).collect();
        let verdict = judge.judge(&screening, &without, &with);

        let best = verdict.chosen();
        let place = best.and_then(|best| {
            with.iter().position(|(k, _)| evidence.signatures[*k].effect.name == best.effect)
        });
        let (after, after_fit) = match place {
            Some(n) => (&with[n].1, &fits[n]),
            None => (&without, &without_fit),
        };
        let active = without_fit.poses.first().map_or(&[][..], |pose| &pose.active);
        let nodes: Vec<u32> = evidence.weighed.iter().map(|&at| active[at as usize]).collect();
        let faces = mesh.corners().patch(Patch::Skin).to_vec();
        let gap = |(p, pose): (usize, &String)| {
            let own = |all| part(all, &[p], evidence.nodes()).as_slice().to_vec();
            // Of corners alone, since nodes between them are not weighed.
            let simulated = |fit: &Fit| TriMesh {
                points: fit.poses[p + 1].solution.points.clone(),
                triangles: faces.clone(),
            };
            PoseGap {
                pose: pose.clone(),
                skin: [simulated(&without_fit), simulated(after_fit)],
                active: nodes.clone(),
                before_mm: own(&without.residual),
                after_mm: own(&after.residual),
                rms_mm: judge.rms_mm(p, &without.residual, &after.residual),
            }
        };
        Ok(Discovery {
            gaps: evidence.poses.iter().enumerate().map(gap).collect(),
            drift: judge.drift(),
            budget: evidence.budget,
            clusters: clusters::clusters(&judge, evidence, &mesh.anatomy, &without.residual),
            verdict,
            screening,
        })
    }
}
