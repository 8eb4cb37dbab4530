//! One breast between paddle and receptor.

use crate::{
    calibrate::Calibration,
    load_steps::{self, LoadStep},
    mesh::BreastMesh,
    model::{Anatomy, Body, LawOverride},
};
use mammotwin_data::{
    Failure, Mat3, Vec3,
    io::hdf5,
    labels::Side,
    mesh::{Patch, TetMesh},
    progress::{Part, Progress, Silent},
    rigid::RigidTransform,
    solution::Solution,
    store::{Artifact, Stage},
    study::{CompressPlan, HingePlan, ModelPlan, PaddleName, Stop},
    surface::TriMesh,
    units::NEWTON,
};
use mammotwin_solver::{
    Options, SolveError, compress as press, mesh::crop::crop, paddles::Hinge, solve,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Compresses one breast, from its stress-free shape and without gravity.
#[derive(Debug, Clone, Serialize)]
pub struct Compress {
    /// Tissues and supports.
    pub model: ModelPlan,
    /// Side, paddle, position, stop and law.
    pub plan: CompressPlan,
}

/// The course of a compression.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Course {
    /// Distance of the plates (mm).
    pub thickness_mm: Vec<f64>,
    /// Tilt of the paddle (degrees), positive when the side of the nipple sinks.
    pub tilt_deg: Vec<f64>,
    /// Force of the paddle (N).
    pub force_n: Vec<f64>,
    /// Force of the receptor (N).
    pub receptor_force_n: Vec<f64>,
    /// Contact area of the paddle (mm²).
    pub contact_area_mm2: Vec<f64>,
    /// Mean pressure under the paddle (kPa).
    pub mean_pressure_kpa: Vec<f64>,
    /// Largest pressure under either plate (kPa).
    pub peak_pressure_kpa: Vec<f64>,
}

/// A compressed breast, in the detector's frame: x along the chest-wall edge of the plates from the
/// nipple, y away from the chest wall from that edge, z from the receptor to the paddle (mm).
#[derive(Debug, Clone)]
pub struct Compression {
    /// Which breast.
    pub side: Side,
    /// The breast's part of the mesh, in its stress-free shape.
    pub mesh: TetMesh,
    /// The breast between the plates.
    pub solution: Solution,
    /// Contact pressure (kPa) at the nodes.
    pub contact_pressure_kpa: Vec<f64>,
    /// Distance of the plates at the end (mm).
    pub thickness_mm: f64,
    /// From the reference pose to the detector's frame.
    pub to_detector: RigidTransform,
    /// How they got there.
    pub curve: Course,
    /// The states of `curve`.
    pub steps: Vec<LoadStep>,
    /// Node that is the nipple.
    pub nipple_node: u32,
    /// Why the compression ended before its stop rule; `None` when it was met.
    pub stopped_early: Option<String>,
}

impl Compression {
    /// Place of the nipple between the plates (mm).
    pub fn nipple(&self) -> Vec3 {
        self.solution.points[self.nipple_node as usize]
    }

    /// The closed surface of the compressed part (mm).
    pub fn outer_surface(&self) -> TriMesh {
        let triangles = self.mesh.outer_surface().triangles;
        TriMesh { points: self.solution.points.clone(), triangles }
    }

    /// Contact pressure (kPa) with its area (mm²), node by node, where there is any.
    pub fn contact_pressures(&self) -> Vec<(f64, f64)> {
        let skin = TriMesh {
            points: self.solution.points.clone(),
            triangles: self.mesh.patch(Patch::Skin).to_vec(),
        };
        let mut area = vec![0.0; skin.points.len()];
        for t in 0..skin.triangles.len() {
            let third = skin.area_vector(t).norm() / 3.0;
            for n in skin.triangles[t] {
                area[n as usize] += third;
            }
        }
        let both = self.contact_pressure_kpa.iter().copied().zip(area);
        both.filter(|&(pressure, area)| pressure > 0.0 && area > 0.0).collect()
    }

    /// The stress-free mesh and the solution in the frame of the reference pose.
    pub fn in_reference_pose(&self) -> (TetMesh, Solution) {
        let back = self.to_detector.inverse();
        let points = self.mesh.points.iter().map(|p| back.point(p)).collect();
        (TetMesh { points, ..self.mesh.clone() }, self.solution.moved(&back))
    }

    /// Volume (mm³) of each compressed tetrahedron.
    pub fn volumes_mm3(&self) -> Vec<f64> {
        let volume = |tet| TetMesh::tet_volume(&self.solution.points, tet);
        self.mesh.tets.iter().map(volume).collect()
    }
}

impl Stage for Compress {
    const NAME: &'static str = "compress";
    const VERSION: u32 = 5;
    const METHODS: &'static str = "The breast was compressed between two flat plates, frictionless and fixed in their direction \
         unless stated otherwise, their rounded edges along the chest wall under it, from its stress-free shape and without gravity (the thesis \
         neglects its prestress, too).";
    type Input = (BreastMesh, Calibration);
    type Output = Compression;

    fn run(
        &self,
        (whole, calibration): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Compression, Failure> {
        let side = self.plan.side;
        let Some(base) = whole.anatomy.breast(side) else {
            let text = format!("compress.side: the mesh has no {} breast", side.name());
            return Err(Failure::BadInput(text));
        };
        let part = crop(&whole.mesh, side, whole.anatomy.sternum_x_mm, 0.0);
        let anatomy = Anatomy { breasts: vec![base.clone()], ..whole.anatomy.clone() };
        let body = Body { mesh: &part.mesh, anatomy: &anatomy, ..Body::new(whole, &self.model) };
        let rest = part.take(&calibration.after.rest);
        let moduli = calibration.after.moduli;
        let law = LawOverride {
            name: self.plan.law.name,
            jm: self.plan.law.jm,
            constants: self.plan.law.constants,
            poisson: self.plan.law.poisson,
        };
        let refuse = |cause: SolveError| Failure::Numerics(format!("compress: {cause}"));
        let options = Options::default();
        // Without gravity a bonded breast rests in its stress-free shape; one that slides is
        // first brought onto the chest wall.
        let settled = if self.model.interface.is_bonded() {
            rest.clone()
        } else {
            progress.report(0.0, "without gravity");
            let free = body.model(&rest, moduli, Vec3::zeros(), Some(law))?;
            solve(&free, &rest, &options, &Silent)
                .map_err(|cause| Failure::Numerics(format!("compress, settling: {cause}")))?
                .points
        };

        // The cut at the sternum stays where it settled.
        let mut model = body.model(&rest, moduli, Vec3::zeros(), Some(law))?;
        for node in part.mesh.patch_nodes(Patch::Medial) {
            model.fix_node(node);
        }
        let near = |n: &u32| base.radius(&part.mesh.points[*n as usize]) < TOUCHED_RADIUS;
        let skin = part.mesh.patch(Patch::Skin).iter();
        // She turns and leans until the plates' edges lie along the chest wall under her breast.
        let plates = press::Plates {
            axis: base.cranial,
            away: base.normal,
            edge_mm: base.normal.dot(&base.center) + self.plan.chest_wall_distance_mm,
            radius_mm: EDGE_RADIUS_MM,
            friction: self.plan.friction,
            hinge: self.hinge(),
            faces: skin.filter(|face| face.iter().all(near)).copied().collect(),
        };
        let nipple_node = nearest(&part.mesh.points, &base.nipple);
        let closing = self.closing(&plates, &settled, nipple_node)?;
        let part_of = Part { whole: progress, from: 0.1, to: 1.0 };
        let done = press::compress(model, &plates, &closing, &settled, &options, &part_of)
            .map_err(refuse)?;
        let mesh = TetMesh { points: rest, ..part.mesh };
        Ok(result(side, mesh, nipple_node, &plates, done))
    }
}

/// Skin within this elliptic radius of the base may touch the plates.
const TOUCHED_RADIUS: f64 = 1.25;
/// Radius (mm) of the plates' edges.
const EDGE_RADIUS_MM: f64 = 6.0;
/// Largest change (mm) of the thickness between recorded states.
const STEP_MM: f64 = 5.0;

impl Compress {
    fn hinge(&self) -> Option<Hinge> {
        let HingePlan { axis_mm, linear_n_mm_per_rad, quadratic_n_mm_per_rad2 } =
            match self.plan.paddle {
                PaddleName::Rigid => return None,
                PaddleName::Flex => self.plan.hinge.unwrap_or_default(),
            };
        let linear_mn_mm = linear_n_mm_per_rad * NEWTON;
        let quadratic_mn_mm = quadratic_n_mm_per_rad2 * NEWTON;
        Some(Hinge { axis_mm, linear_mn_mm, quadratic_mn_mm })
    }

    /// Both plates come alike to the height of the nipple: the receptor is raised to the breast.
    fn closing(
        &self,
        plates: &press::Plates,
        points: &[Vec3],
        nipple_node: u32,
    ) -> Result<press::Closing, Failure> {
        let (low, height) = plates.touching(points);
        if !(height > 0.0 && height.is_finite()) {
            return Err(Failure::BadInput(format!(
                "compress.chest_wall_distance_mm: {} mm from the chest wall there is no breast; \
                 bring the paddle nearer",
                self.plan.chest_wall_distance_mm
            )));
        }
        let nipple = plates.axis.dot(&points[nipple_node as usize]);
        let middle = nipple.clamp(low, low + height);
        let thickness_mm = 2.0 * (low + height - middle).max(middle - low);
        let stop = match self.plan.stop {
            Stop::ThicknessMm(goal) if goal >= height => {
                return Err(Failure::BadInput(format!(
                    "compress.stop.thickness_mm: {goal} mm is more than the {height:.0} mm of \
                     breast under the paddle; ask for less, or bring the paddle nearer"
                )));
            }
            Stop::ThicknessMm(goal) => press::Stop::ThicknessMm(goal),
            Stop::ForceN(goal) => press::Stop::ForceMn(goal * NEWTON),
        };
        Ok(press::Closing {
            receptor_mm: middle - 0.5 * thickness_mm,
            thickness_mm,
            receptor_share: 0.5,
            step_mm: STEP_MM,
            stop,
        })
    }
}

fn nearest(points: &[Vec3], place: &Vec3) -> u32 {
    let far = |p: &Vec3| (p - place).norm_squared();
    let best = (0..points.len()).min_by(|&a, &b| far(&points[a]).total_cmp(&far(&points[b])));
    best.unwrap_or(0) as u32
}

/// From the pose of the body to the frame of the detector at the end.
fn to_detector(plates: &press::Plates, receptor_mm: f64, nipple: &Vec3) -> RigidTransform {
    let along = plates.away.cross(&plates.axis);
    let rotation =
        Mat3::from_rows(&[along.transpose(), plates.away.transpose(), plates.axis.transpose()]);
    let corner = Vec3::new(along.dot(nipple), plates.edge_mm, receptor_mm);
    RigidTransform { rotation, translation: -corner }
}

fn result(
    side: Side,
    mesh: TetMesh,
    nipple_node: u32,
    plates: &press::Plates,
    done: press::Compressed,
) -> Compression {
    let of = |f: fn(&press::Step) -> f64| done.steps.iter().map(f).collect::<Vec<f64>>();
    let curve = Course {
        thickness_mm: of(|s| s.thickness_mm),
        tilt_deg: of(|s| s.tilt_rad.to_degrees()),
        force_n: of(|s| s.paddle_force_mn / NEWTON),
        receptor_force_n: of(|s| s.receptor_force_mn / NEWTON),
        contact_area_mm2: of(|s| s.contact_area_mm2),
        mean_pressure_kpa: of(|s| s.mean_pressure_kpa),
        peak_pressure_kpa: of(|s| s.peak_pressure_kpa),
    };
    let last = done.steps.last();
    let nodes = mesh.points.len();
    let nipple = &done.solution.points[nipple_node as usize];
    let to_detector = to_detector(plates, last.map_or(0.0, |s| s.receptor_mm), nipple);
    let points = mesh.points.iter().map(|p| to_detector.point(p)).collect();
    let (origin_mm, axis_mm) =
        (last.map_or(0.0, |s| s.receptor_mm), plates.hinge.map_or(0.0, |hinge| hinge.axis_mm));
    let steps =
        done.steps.iter().map(|s| LoadStep::of(s, &to_detector, origin_mm, axis_mm)).collect();
    Compression {
        side,
        mesh: TetMesh { points, ..mesh },
        solution: done.solution.moved(&to_detector),
        contact_pressure_kpa: last.map_or(vec![0.0; nodes], |s| s.contact_pressure_kpa.clone()),
        thickness_mm: last.map_or(0.0, |s| s.thickness_mm),
        to_detector,
        curve,
        steps,
        nipple_node,
        stopped_early: done.stopped_early.map(|why| why.to_string()),
    }
}

impl Artifact for Compression {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Detector)?;
        file.put_mesh("mesh", &self.mesh)?;
        file.put_solution("solution", &self.solution)?;
        let pressure = &self.contact_pressure_kpa;
        file.put("contact_pressure", pressure, "kPa", "contact pressure at the nodes")?;
        file.put_json("side", &self.side, "which breast")?;
        file.put_scalar("thickness", self.thickness_mm, "mm", "distance of the plates")?;
        let frame = "from the reference pose to the detector's frame";
        file.put_json("to_detector", &self.to_detector, frame)?;
        file.put_json("course", &self.curve, "the course of the compression")?;
        load_steps::put(&mut file, "steps", &self.steps)?;
        file.put_json("nipple_node", &self.nipple_node, "node that is the nipple")?;
        file.put_json("stopped_early", &self.stopped_early, "why it ended before its stop rule")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        Ok(Self {
            side: file.json("side")?,
            mesh: file.mesh("mesh")?,
            solution: file.solution("solution")?,
            contact_pressure_kpa: file.get("contact_pressure")?,
            thickness_mm: file.scalar("thickness")?,
            to_detector: file.json("to_detector")?,
            curve: file.json("course")?,
            steps: load_steps::get(&file, "steps")?,
            nipple_node: file.json("nipple_node")?,
            stopped_early: file.json("stopped_early")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::study;

    /// A triangle of skin 30 mm high stands for the breast.
    fn closing(stop: &str, edge_mm: f64) -> Result<press::Closing, Failure> {
        let text = format!(
            "schema = 1\nsubject = {{ id = \"x\" }}\n[poses.prone]\nimage = \"x.nii\"\n\
             posture = \"prone\"\n[compress]\nside = \"right\"\nchest_wall_distance_mm = 20.0\n\
             stop = {stop}\nlaw = {{ name = \"neo_hookean\" }}\n"
        );
        let study = study::parse(&text).unwrap();
        let compress = Compress { model: study.model, plan: study.compress.unwrap() };
        let plates = press::Plates {
            axis: Vec3::z(),
            away: Vec3::y(),
            edge_mm,
            radius_mm: EDGE_RADIUS_MM,
            friction: 0.0,
            hinge: None,
            faces: vec![[0, 1, 2]],
        };
        let points = [[0.0, 40.0, -10.0], [0.0, 40.0, 20.0], [0.0, 50.0, 5.0]].map(Vec3::from);
        compress.closing(&plates, &points, 2)
    }

    #[test]
    fn a_gap_larger_than_the_breast_or_a_paddle_before_it_is_bad_input() {
        assert!(closing("{ thickness_mm = 20.0 }", 30.0).is_ok());
        for (stop, edge_mm, says) in [
            ("{ thickness_mm = 35.0 }", 30.0, "more than the 30 mm of breast"),
            ("{ thickness_mm = 20.0 }", 60.0, "bring the paddle nearer"),
        ] {
            match closing(stop, edge_mm) {
                Err(Failure::BadInput(text)) => assert!(text.contains(says), "{text}"),
                other => panic!("{other:?}"),
            }
        }
    }
}
