//! The body in one pose: which stress-free material point is at a place of the image.

use super::{carry::Shapes, field::Field, motion::Motion, thorax::thorax, torso::Torso};
use mammotwin_data::{Vec3, labels::Tissue, rigid::RigidTransform};
use mammotwin_imaging::mri::synthesize::{Sample, Substance};

/// A person in a pose.
///
/// A place of the image is carried back in three steps: the table motion, the change of the
/// chest (and, in soft tissue, of the arms), and the deformation under gravity. Behind the chest
/// wall the last step is nothing: that is where tissue slides.
#[derive(Debug, Clone)]
pub struct PosedBody<'a> {
    torso: &'a Torso,
    to_common: RigidTransform,
    /// From the moved to the unmoved chest.
    deep: Field,
    /// From moved and deformed soft tissue to its stress-free place.
    soft: Field,
}

impl<'a> PosedBody<'a> {
    /// Prepares a pose within a box of the image frame. `shapes` are the stress-free body and
    /// the body under gravity; deformations are kept on a lattice of `lattice_mm`.
    pub fn new(
        torso: &'a Torso,
        motion: &Motion,
        shapes: &Shapes,
        image_box: [Vec3; 2],
        lattice_mm: f64,
    ) -> Self {
        let corners = (0..8).map(|n: usize| {
            let pick = |axis: usize| image_box[n >> axis & 1][axis];
            motion.to_common.point(&Vec3::new(pick(0), pick(1), pick(2)))
        });
        let (mut low, mut high) = (Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN));
        for corner in corners {
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        let gravity_back = shapes.backward(low, high, lattice_mm, &torso.limits);
        let deep = Field::sampled(low, high, 8.0, |p| {
            let mut x = *p;
            for _ in 0..4 {
                x = p - motion.chest.at(&x);
            }
            x - p
        });
        let soft = Field::sampled(low, high, lattice_mm, |p| {
            let mut x = *p;
            for _ in 0..4 {
                let wall = torso.chest_wall(&x);
                x = p - motion.chest.at(&x) - motion.arms.at(&x, wall);
            }
            x + gravity_back.at(&x) - p
        });
        Self { torso, to_common: motion.to_common, deep, soft }
    }

    /// What is at a place of the image (mm).
    pub fn sample(&self, p: &Vec3) -> Sample {
        let here = self.to_common.point(p);
        let chest = &self.torso.person.chest;
        if here.z.abs() > chest.half_extent_z_mm + 40.0 {
            return air(here);
        }
        let fixed = here + self.deep.at(&here);
        let rib_cage = self.torso.rib_cage(&fixed);
        if rib_cage <= chest.muscle_thick_mm * 1.2 {
            let chest_wall = self.torso.chest_wall(&fixed);
            if chest_wall <= 0.0 {
                let (substance, tissue) = thorax(self.torso, &fixed, rib_cage);
                return Sample { substance, tissue, material: fixed };
            }
        }
        let material = here + self.soft.at(&here);
        let chest_wall = self.torso.chest_wall(&material);
        let (substance, tissue) = self.torso.soft(&material, chest_wall);
        Sample { substance, tissue, material }
    }
}

fn air(material: Vec3) -> Sample {
    Sample { substance: Substance::Air, tissue: Tissue::Background, material }
}
