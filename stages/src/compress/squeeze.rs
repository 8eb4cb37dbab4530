//! The compression itself: a body of one's own mesh between the plates of a plan.

use super::{Compress, Compression, Start, paddle, result};
use crate::model::{Anatomy, Body, LawOverride, Moduli};
use mammotwin_data::{
    Failure, Vec3,
    mesh::{Patch, TetMesh},
    progress::{Part, Progress, Silent},
    study::{ModelPlan, ReceptorName},
    surface::TriMesh,
    units::NEWTON,
};
use mammotwin_solver::{
    Options, SolveError, assemble::Analyses, compress as press, mesh::crop::crop, model::Model,
    solve,
};

/// Skin within this elliptic radius of the base may touch the plates.
const TOUCHED_RADIUS: f64 = 1.25;
/// Largest change (mm) of the thickness between recorded states.
const STEP_MM: f64 = 5.0;

impl Compress {
    /// Compresses one breast of a body of linear elements; `cad` is the surface of a paddle from a file.
    ///
    /// # Errors
    /// [`Failure::BadInput`] for plates that miss the breast, [`Failure::Numerics`] when there is no
    /// equilibrium.
    pub fn press(
        &self,
        body: &Body<'_>,
        start: &Start<'_>,
        moduli: Moduli,
        cad: Option<&TriMesh>,
        progress: &dyn Progress,
    ) -> Result<Compression, Failure> {
        let side = self.plan.side;
        let Some(base) = body.anatomy.breast(side) else {
            let text = format!("compress.side: the mesh has no {} breast", side.name());
            return Err(Failure::BadInput(text));
        };
        let mut part = crop(body.mesh, side, body.anatomy.sternum_x_mm, 0.0);
        let muscle = body.muscle.map(|muscle| muscle.cropped(&mut part, &body.mesh.points));
        let part = part;
        let anatomy = Anatomy { breasts: vec![base.clone()], ..body.anatomy.clone() };
        let (mesh, anatomy) = (&part.mesh, &anatomy);
        let stiffer = 1.0 + self.plan.rate_stiffening;
        let plan = &stiffened(&moduli.applied(body.plan), stiffer);
        let (quadratic, muscle) = (None, muscle.as_ref());
        let (wall, analyses) = (body.wall.clone(), Analyses::default());
        let body = Body { mesh, anatomy, plan, quadratic, muscle, wall, analyses };
        let moduli = Moduli::of(plan);
        let rest = part.take(start.rest);
        let law = LawOverride {
            name: self.plan.law.name,
            jm: self.plan.law.jm,
            constants: self.plan.law.constants,
            poisson: self.plan.law.poisson,
        };
        let refuse = |cause: SolveError| Failure::Numerics(format!("compress: {cause}"));
        let options = Options::default();
        let medial = part.mesh.patch_nodes(Patch::Medial);
        let held = |weight: Vec3| {
            let mut model = body.model(&rest, moduli, weight, Some(law))?;
            let behind = muscle.iter().flat_map(|muscle| muscle.behind_nodes(&medial));
            for node in medial.iter().copied().chain(behind) {
                model.fix_node(node);
            }
            Ok::<_, Failure>(model)
        };
        let settle = |model: &Model, from: &[Vec3]| {
            solve(model, from, &options, &Silent)
                .map(|settled| settled.points)
                .map_err(|cause| Failure::Numerics(format!("compress, settling: {cause}")))
        };
        // Without gravity a bonded breast rests in its stress-free shape; one that slides is
        // first brought onto the chest wall. One that hangs sinks a little: its law is another now.
        let settled = if let Some((points, gravity)) = start.hanging {
            progress.report(0.0, "hanging");
            settle(&held(gravity)?, &part.take(points))?
        } else if plan.interface.is_bonded() {
            rest.clone()
        } else {
            progress.report(0.0, "without gravity");
            settle(&body.model(&rest, moduli, Vec3::zeros(), Some(law))?, &rest)?
        };

        // The plates come to the breast where it would be without weight, as hands would lift it; she stands
        // and leans until the plates' edges lie along the chest wall. Or she lies, and it hangs.
        let standing = -self.plan.gravity_share * base.cranial;
        let weight = start.hanging.map_or(standing, |(_, gravity)| gravity);
        // The cut at the sternum stays where it settled.
        let model = held(weight)?;
        let near = |n: &u32| base.radius(&part.mesh.points[*n as usize]) < TOUCHED_RADIUS;
        let skin = part.mesh.patch(Patch::Skin).iter();
        // She turns and leans until the plates' edges lie along the chest wall under her breast.
        let (sin, cos) = self.plan.angle_deg().to_radians().sin_cos();
        // An oblique paddle comes from above and the middle.
        let axis = cos * base.cranial - sin * base.lateral;
        let along = base.normal.cross(&axis);
        let (paddle, outline) = paddle::paddle(&self.plan, cad)?;
        let plates = press::Plates {
            axis,
            away: base.normal,
            edge_mm: base.normal.dot(&base.center) + self.plan.chest_wall_distance_mm,
            radius_mm: self.plan.edge_radius_mm,
            friction: self.plan.friction,
            paddle,
            outline,
            middle_mm: along.dot(&base.center),
            faces: skin.filter(|face| face.iter().all(near)).copied().collect(),
        };
        let nipple_node = nearest(&part.mesh.points, &base.nipple);
        let fold_mm = axis.dot(&base.fold());
        let closing = self.closing(&plates, &settled, nipple_node, fold_mm)?;
        let part_of = Part { whole: progress, from: 0.1, to: 1.0 };
        let mut done = press::compress(model, &plates, &closing, &settled, &options, &part_of)
            .map_err(refuse)?;
        body.join(&mut done.solution.points);
        done.steps.iter_mut().for_each(|step| body.join(&mut step.points));
        let mut rest = rest;
        body.join(&mut rest);
        let muscle = muscle.map_or(Vec::new(), |muscle| muscle.tets.clone());
        let mesh = TetMesh { points: rest, ..part.mesh.clone() };
        Ok(Compression { muscle, ..result(side, mesh, nipple_node, &plates, done) })
    }

    /// Both plates come alike to the height of the nipple: the receptor is raised to the breast. Or it comes to the
    /// fold, `fold_mm` along the axis: from the lowest skin between the plates where that hangs lower, while the paddle
    /// waits as far above the highest; then the paddle comes down.
    pub(super) fn closing(
        &self,
        plates: &press::Plates,
        points: &[Vec3],
        nipple_node: u32,
        fold_mm: f64,
    ) -> Result<press::Closing, Failure> {
        let (low, height) = plates.touching(points);
        if !(height > 0.0 && height.is_finite()) {
            return Err(Failure::BadInput(format!(
                "compress.chest_wall_distance_mm: {} mm from the chest wall there is no breast; \
                 bring the paddle nearer",
                self.plan.chest_wall_distance_mm
            )));
        }
        let raised_mm = self.plan.receptor_lift_mm;
        let too_far = |what: &str, mm: f64| {
            let raised = if raised_mm < 0.0 { "below" } else { "above" };
            Failure::BadInput(format!(
                "compress.receptor_lift_mm: {raised_mm} mm bring {what} {mm:.0} mm {raised} the breast; give less"
            ))
        };
        let (receptor_mm, thickness_mm, receptor_share, lift_mm) = match self.plan.receptor {
            ReceptorName::Nipple => {
                let nipple = plates.axis.dot(&points[nipple_node as usize]);
                let middle = nipple.clamp(low, low + height) + raised_mm;
                if !(low..=low + height).contains(&middle) {
                    let beyond = (low - middle).max(middle - low - height);
                    return Err(too_far("the middle between the plates", beyond));
                }
                let thickness_mm = 2.0 * (low + height - middle).max(middle - low);
                (middle - 0.5 * thickness_mm, thickness_mm, 0.5, 0.0)
            }
            ReceptorName::Fold => {
                let goal = fold_mm + raised_mm;
                if fold_mm >= low + height {
                    let text = "compress.receptor: the fold lies above the breast under the paddle; choose \"nipple\", or \
                                another distance from the chest wall";
                    return Err(Failure::BadInput(text.into()));
                }
                if goal >= low + height {
                    return Err(too_far("the receptor", goal - low - height));
                }
                let lift_mm = (goal - low).max(0.0);
                (goal.min(low), low + height + lift_mm - goal.min(low), 0.0, lift_mm)
            }
        };
        let stop = &self.plan.stop;
        if let Some(goal) = stop.thickness_mm.filter(|goal| *goal >= height) {
            return Err(Failure::BadInput(format!(
                "compress.stop.thickness_mm: {goal} mm is more than the {height:.0} mm of \
                 breast under the paddle; ask for less, or bring the paddle nearer"
            )));
        }
        Ok(press::Closing {
            receptor_mm,
            thickness_mm,
            receptor_share,
            lift_mm,
            step_mm: STEP_MM,
            stops: press::Stops {
                thickness_mm: stop.thickness_mm,
                force_mn: stop.force_n.map(|force| force * NEWTON),
                mean_pressure_kpa: stop.mean_pressure_kpa,
                peak_pressure_kpa: stop.peak_pressure_kpa,
                least_gain_mm_per_n: stop.least_gain_mm_per_n,
            },
        })
    }
}

/// Tissues and ligaments stiffer by a factor; the moduli of the breasts are not in a plan.
fn stiffened(plan: &ModelPlan, factor: f64) -> ModelPlan {
    let mut plan = plan.clone();
    plan.breast.young_right_kpa *= factor;
    plan.breast.young_left_kpa *= factor;
    plan.skin.young_kpa *= factor;
    plan.fascia.young_kpa *= factor;
    plan.ligaments.young_kpa *= factor;
    plan.muscle.young_kpa *= factor;
    plan
}

fn nearest(points: &[Vec3], place: &Vec3) -> u32 {
    let far = |p: &Vec3| (p - place).norm_squared();
    let best = (0..points.len()).min_by(|&a, &b| far(&points[a]).total_cmp(&far(&points[b])));
    best.unwrap_or(0) as u32
}
