//! The pectoral muscle behind the breasts as tetrahedra: a deformable chest wall.

use crate::{
    mesh::{BreastMesh, WALL_SPACING_MM},
    model::Muscle,
};
use mammotwin_data::{
    Failure,
    labels::{LabelMap, Tissue},
    progress::Progress,
    store::Stage,
};
use mammotwin_imaging::mri::distance_field::{FieldPlan, distance_field};
use mammotwin_solver::{
    mesh::quality::Summary,
    terms::{GridDistance, Target},
};
use serde::Serialize;

/// Limits of the shape of elements (Mîra 2018, § 2.2.2).
const MOST_SKEWNESS: f64 = 0.95;
const MOST_ASPECT_RATIO: f64 = 20.0;
const MOST_ANGLE_DEG: f64 = 165.0;

/// Fills the space between the rear of the breasts and the front of the ribs with tetrahedra.
///
/// The muscle is as thick as the thorax is far from the chest wall, and 4 mm at least: the wall beside and
/// below the muscle is the thorax itself, and a layer of no thickness has no elements.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PectoralMuscle;

impl Stage for PectoralMuscle {
    const NAME: &'static str = "muscle";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "The pectoral muscle between the chest wall and the ribs was filled with two layers of \
         tetrahedra on the nodes of the breast's rear.";
    type Input = (BreastMesh, LabelMap);
    type Output = BreastMesh;

    fn run(
        &self,
        (breasts, labels): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<BreastMesh, Failure> {
        if breasts.quadratic.is_some() {
            return Err(Failure::BadInput(
                "model.muscle.rigid: a deformable muscle has linear elements; set mesh.elements to \
                 \"linear\", or rigid to true"
                    .into(),
            ));
        }
        progress.report(0.1, "distance field of the ribs");
        let plan = FieldPlan::of_spacing(WALL_SPACING_MM);
        let thorax = distance_field(&labels.map(|tissue| tissue == Tissue::Thorax), &plan)
            .map_err(|cause| Failure::BadInput(format!("labels: thorax: {cause}")))?;
        let (front, ribs) = (GridDistance::new(&breasts.wall), GridDistance::new(&thorax));
        progress.report(0.6, "tetrahedra");
        let mut found = breasts.clone();
        let muscle = Muscle::behind(&mut found.mesh, &front, |p| ribs.distance(p).0);
        check(&muscle.quality)?;
        found.muscle = Some(muscle);
        Ok(found)
    }
}

/// Refuses elements that no solution can be trusted on.
fn check(shape: &Summary) -> Result<(), Failure> {
    let good = shape.min_volume_mm3 > 0.0
        && shape.max_skewness <= MOST_SKEWNESS
        && shape.max_aspect_ratio <= MOST_ASPECT_RATIO
        && shape.max_angle_deg <= MOST_ANGLE_DEG;
    if good {
        return Ok(());
    }
    Err(Failure::Numerics(format!(
        "muscle: its worst elements have skewness {:.2}, aspect ratio {:.0} and an angle of {:.0}° (limits {MOST_SKEWNESS}, \
         {MOST_ASPECT_RATIO}, {MOST_ANGLE_DEG}°): the chest wall is too rough for elements of this size; mesh finer, \
         correct the labels, or set model.muscle.rigid to true",
        shape.max_skewness, shape.max_aspect_ratio, shape.max_angle_deg
    )))
}
