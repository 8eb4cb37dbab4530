//! One breast between paddle and receptor.

mod leaps;
mod paddle;
mod squeeze;

pub use leaps::Leap;
pub use paddle::from_cad;

use crate::{
    calibrate::{Calibration, Fit},
    load_steps::{self, LoadStep},
    mesh::BreastMesh,
    model::Body,
};
use mammotwin_data::{
    Failure, Mat3, Vec3,
    io::hdf5,
    labels::Side,
    mesh::TetMesh,
    progress::Progress,
    rigid::RigidTransform,
    solution::Solution,
    store::{Artifact, Stage},
    study::{CompressPlan, ModelPlan},
    surface::TriMesh,
    units::NEWTON,
};
use mammotwin_imaging::xray::dose::nominal_thickness_mm;
use mammotwin_solver::compress as press;
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

/// Where a compression begins.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Nodes (mm) where the body is free of stress.
    pub rest: &'a [Vec3],
    /// Nodes (mm) where it hangs by its weight, and the unit vector of gravity there, which goes on acting.
    pub hanging: Option<(&'a [Vec3], Vec3)>,
}

impl<'a> Start<'a> {
    /// Begins free of stress and without weight.
    pub fn free(rest: &'a [Vec3]) -> Self {
        Self { rest, hanging: None }
    }
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
    /// Roll of the paddle about the axis away from the chest wall (degrees).
    pub roll_deg: Vec<f64>,
    /// How far (mm) the paddle gives way at most where it is touched, by bending, tilt, roll or foam.
    pub deflection_mm: Vec<f64>,
    /// How far (mm) skin stands out above the paddle's surface at most, beside it or in its window.
    pub bulge_mm: Vec<f64>,
    /// Largest motion (mm) of a node since the state before; zero for the first.
    pub moved_mm: Vec<f64>,
    /// Contact area of the paddle (mm²), as seen along the compression: without its front.
    pub contact_area_mm2: Vec<f64>,
    /// Contact area of the paddle's upright front (mm²), as seen across the compression.
    pub front_area_mm2: Vec<f64>,
    /// The same of its other upright edges: sides, rear and window of a finite paddle.
    pub edge_area_mm2: Vec<f64>,
    /// Force of the paddle over its contact area (kPa).
    pub mean_pressure_kpa: Vec<f64>,
    /// Largest pressure under either plate (kPa).
    pub peak_pressure_kpa: Vec<f64>,
    /// Largest pressure on the paddle's face (kPa): without its front and other upright edges.
    pub paddle_peak_pressure_kpa: Vec<f64>,
}

/// What a plate does at the end, node by node.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlateContact {
    /// Force of the plate on each node, along the plate's normal, without friction (mN).
    pub force_mn: Vec<Vec3>,
    /// Area of the plate that the skin around each node covers, along the plate's surface (mm²).
    pub area_mm2: Vec<f64>,
}

impl PlateContact {
    fn of(pressing: &[press::Pressing], nodes: usize, to_detector: &RigidTransform) -> Self {
        let mut contact = Self { force_mn: vec![Vec3::zeros(); nodes], area_mm2: vec![0.0; nodes] };
        for one in pressing {
            contact.force_mn[one.node as usize] = to_detector.direction(&one.force_mn);
            contact.area_mm2[one.node as usize] = one.area_mm2;
        }
        contact
    }

    /// The nodes that it touches, in the detector's frame.
    pub fn touched(&self) -> impl Iterator<Item = press::Pressing> + '_ {
        let all = self.force_mn.iter().zip(&self.area_mm2).enumerate();
        all.filter(|(_, (_, area))| **area > 0.0).map(|(node, (force, area))| press::Pressing {
            node: node as u32,
            force_mn: *force,
            area_mm2: *area,
        })
    }
}

/// A compressed breast, in the detector's frame: x along the chest-wall edge of the plates from the
/// nipple, y away from the chest wall from that edge, z from the receptor to the paddle (mm).
#[derive(Debug, Clone)]
pub struct Compression {
    /// Which breast.
    pub side: Side,
    /// The breast's part of the mesh, in its stress-free shape.
    pub mesh: TetMesh,
    /// The muscle behind it where that is deformable, on the last nodes of `mesh`.
    pub muscle: Vec<[u32; 4]>,
    /// The breast between the plates.
    pub solution: Solution,
    /// Contact pressure (kPa) at the nodes.
    pub contact_pressure_kpa: Vec<f64>,
    /// What the receptor and the paddle do.
    pub plates: [PlateContact; 2],
    /// Distance of the plates at the end (mm), at the frame of a paddle that tilts or bends.
    pub thickness_mm: f64,
    /// Mean of the smallest and the largest distance of the plates where skin touches the paddle
    /// (mm): the thickness that a mammogram is given.
    pub nominal_thickness_mm: f64,
    /// Border of a finite paddle and of its window, x and y (mm); empty for an endless one.
    pub outline_mm: Vec<Vec<[f64; 2]>>,
    /// From the reference pose to the detector's frame.
    pub to_detector: RigidTransform,
    /// How they got there.
    pub curve: Course,
    /// The states of `curve`.
    pub steps: Vec<LoadStep>,
    /// Node that is the nipple.
    pub nipple_node: u32,
    /// The key of `compress.stop` that ended it; `None` when none was reached.
    pub met: Option<String>,
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

    /// Area (mm²) of both plates' faces that the skin around each node covers, as seen along the
    /// compression; their upright edges do not count.
    pub fn face_areas_mm2(&self) -> Vec<f64> {
        let (mut areas, axis) = (vec![0.0; self.mesh.points.len()], Vec3::z());
        for one in self.plates.iter().flat_map(|plate| plate.touched()) {
            if !one.is_upright(&axis) {
                areas[one.node as usize] += one.face_area(&axis);
            }
        }
        areas
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
    const VERSION: u32 = 12;
    const METHODS: &'static str = "The breast was compressed between two plates, flat, frictionless and fixed in their direction \
         unless stated otherwise, their rounded edges along the chest wall under it, the paddle as large as its outline, from its stress-free shape and without gravity (the thesis \
         neglects its prestress, too); a share of the weight of an upright person, or weight and stress of a \
         lying one, act where stated.";
    /// The surface is that of a paddle from CAD.
    type Input = (BreastMesh, Calibration, Option<TriMesh>);
    type Output = Compression;

    fn run(
        &self,
        (whole, calibration, cad): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Compression, Failure> {
        let body = Body { mesh: &whole.corners(), ..Body::new(whole, &self.model) };
        let (start, moduli) = (self.start(&calibration.after)?, calibration.after.moduli);
        self.press(&body, &start, moduli, cad.as_ref(), progress)
    }
}

impl Compress {
    /// Where the compression begins, by what was calibrated.
    pub(crate) fn start<'a>(&self, fit: &'a Fit) -> Result<Start<'a>, Failure> {
        let Some(name) = &self.plan.start_pose else { return Ok(Start::free(&fit.rest)) };
        let pose = fit.poses.iter().find(|fit| fit.pose == *name).ok_or_else(|| {
            Failure::BadInput(format!("compress.start_pose: {name} was not simulated"))
        })?;
        let points = &pose.solution.points[..];
        Ok(if self.plan.prestress {
            Start { rest: &fit.rest, hanging: Some((points, pose.gravity)) }
        } else {
            Start::free(points)
        })
    }
}

/// Key of the study.
fn key(rule: press::StopRule) -> String {
    match rule {
        press::StopRule::Thickness => "thickness_mm",
        press::StopRule::Force => "force_n",
        press::StopRule::MeanPressure => "mean_pressure_kpa",
        press::StopRule::PeakPressure => "peak_pressure_kpa",
        press::StopRule::LeastGain => "least_gain_mm_per_n",
    }
    .into()
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
        roll_deg: of(|s| s.roll_rad.to_degrees()),
        deflection_mm: of(|s| s.deflection_mm),
        bulge_mm: of(|s| s.bulge_mm),
        moved_mm: of(|s| s.moved_mm),
        contact_area_mm2: of(|s| s.contact_area_mm2),
        front_area_mm2: of(|s| s.front_area_mm2),
        edge_area_mm2: of(|s| s.edge_area_mm2),
        mean_pressure_kpa: of(|s| s.mean_pressure_kpa),
        peak_pressure_kpa: of(|s| s.peak_pressure_kpa),
        paddle_peak_pressure_kpa: of(|s| s.paddle_peak_pressure_kpa),
    };
    let last = done.steps.last();
    let nodes = mesh.points.len();
    let nipple = &done.solution.points[nipple_node as usize];
    let to_detector = to_detector(plates, last.map_or(0.0, |s| s.receptor_mm), nipple);
    let points = mesh.points.iter().map(|p| to_detector.point(p)).collect();
    let middle = plates.middle_mm - plates.away.cross(&plates.axis).dot(nipple);
    let mut outline_mm = plates.outline.polygons();
    outline_mm.iter_mut().flatten().for_each(|corner| corner[0] += middle);
    let contact = |which: usize| {
        last.map(|s| PlateContact::of(&s.pressing[which], nodes, &to_detector)).unwrap_or_default()
    };
    let origin_mm = last.map_or(0.0, |s| s.receptor_mm);
    let edge_mm = |s: &press::Step| match (plates.paddle.hinge(), plates.paddle.lift()) {
        (Some(hinge), _) => s.tilt_rad.tan() * hinge.axis_mm,
        (None, Some(lift)) => lift.bend([0.0, 0.0], &s.pose).value,
        (None, None) => 0.0,
    };
    let steps = done.steps.iter();
    let steps = steps.map(|s| LoadStep::of(s, &to_detector, origin_mm, edge_mm(s))).collect();
    Compression {
        side,
        muscle: Vec::new(),
        mesh: TetMesh { points, ..mesh },
        solution: done.solution.moved(&to_detector),
        contact_pressure_kpa: last.map_or(vec![0.0; nodes], |s| s.contact_pressure_kpa.clone()),
        plates: [contact(0), contact(1)],
        thickness_mm: last.map_or(0.0, |s| s.thickness_mm),
        nominal_thickness_mm: last
            .and_then(|s| nominal_thickness_mm(s.gaps_mm))
            .unwrap_or_default(),
        outline_mm,
        to_detector,
        curve,
        steps,
        nipple_node,
        met: done.met.map(key),
        stopped_early: done.stopped_early.map(|why| why.to_string()),
    }
}

const PLATES: [&str; 2] = ["receptor", "paddle"];

impl Artifact for Compression {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Detector)?;
        file.put_mesh("mesh", &self.mesh)?;
        if !self.muscle.is_empty() {
            file.put("muscle", &self.muscle, "1", "tetrahedra of the muscle")?;
        }
        file.put_solution("solution", &self.solution)?;
        let pressure = &self.contact_pressure_kpa;
        file.put("contact_pressure", pressure, "kPa", "contact pressure at the nodes")?;
        for (name, plate) in PLATES.iter().zip(&self.plates) {
            let force = &plate.force_mn;
            file.put(&format!("{name}_force"), force, "mN", "force of the plate on each node")?;
            let area = &plate.area_mm2;
            file.put(&format!("{name}_area"), area, "mm2", "area of the plate by node")?;
        }
        file.put_json("side", &self.side, "which breast")?;
        file.put_scalar("thickness", self.thickness_mm, "mm", "distance of the plates")?;
        let long_name = "mean of smallest and largest distance of the plates over the contact";
        file.put_scalar("nominal_thickness", self.nominal_thickness_mm, "mm", long_name)?;
        file.put_json("met", &self.met, "the rule that ended it")?;
        let frame = "from the reference pose to the detector's frame";
        file.put_json("to_detector", &self.to_detector, frame)?;
        let border = "border of a finite paddle and of its window, x and y (mm)";
        file.put_json("outline", &self.outline_mm, border)?;
        file.put_json("course", &self.curve, "the course of the compression")?;
        load_steps::put(&mut file, "steps", &self.steps)?;
        file.put_json("nipple_node", &self.nipple_node, "node that is the nipple")?;
        file.put_json("stopped_early", &self.stopped_early, "why it ended before its stop rule")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let plate = |name: &str| -> Result<PlateContact, Failure> {
            Ok(PlateContact {
                force_mn: file.get(&format!("{name}_force"))?,
                area_mm2: file.get(&format!("{name}_area"))?,
            })
        };
        Ok(Self {
            side: file.json("side")?,
            plates: [plate(PLATES[0])?, plate(PLATES[1])?],
            nominal_thickness_mm: file.scalar("nominal_thickness")?,
            met: file.json("met")?,
            mesh: file.mesh("mesh")?,
            muscle: if file.has("muscle") { file.get("muscle")? } else { Vec::new() },
            solution: file.solution("solution")?,
            contact_pressure_kpa: file.get("contact_pressure")?,
            thickness_mm: file.scalar("thickness")?,
            to_detector: file.json("to_detector")?,
            outline_mm: file.json("outline")?,
            curve: file.json("course")?,
            steps: load_steps::get(&file, "steps")?,
            nipple_node: file.json("nipple_node")?,
            stopped_early: file.json("stopped_early")?,
        })
    }
}

#[cfg(test)]
impl Compression {
    /// A compression to 50 mm of which only the course counts.
    pub(crate) fn of_course(curve: Course) -> Self {
        Self {
            side: Side::Right,
            muscle: Vec::new(),
            mesh: TetMesh::default(),
            solution: Solution::default(),
            contact_pressure_kpa: Vec::new(),
            plates: Default::default(),
            thickness_mm: 50.0,
            nominal_thickness_mm: 50.0,
            outline_mm: Vec::new(),
            to_detector: RigidTransform::identity(),
            curve,
            steps: Vec::new(),
            nipple_node: 0,
            met: None,
            stopped_early: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::study::{self, EDGE_RADIUS_MM};
    use mammotwin_solver::paddles::{Outline, Paddle};

    /// A triangle of skin 30 mm high stands for the breast.
    fn closing(stop: &str, edge_mm: f64, fold_mm: f64) -> Result<press::Closing, Failure> {
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
            paddle: Paddle::Rigid,
            outline: Outline::ENDLESS,
            middle_mm: 0.0,
            faces: vec![[0, 1, 2]],
        };
        let points = [[0.0, 40.0, -10.0], [0.0, 40.0, 20.0], [0.0, 50.0, 5.0]].map(Vec3::from);
        compress.closing(&plates, &points, 2, fold_mm)
    }

    #[test]
    fn a_gap_larger_than_the_breast_or_a_paddle_before_it_is_bad_input() {
        assert!(closing("{ thickness_mm = 20.0 }", 30.0, 0.0).is_ok());
        for (stop, edge_mm, says) in [
            ("{ thickness_mm = 35.0 }", 30.0, "more than the 30 mm of breast"),
            ("{ thickness_mm = 20.0 }", 60.0, "bring the paddle nearer"),
        ] {
            match closing(stop, edge_mm, 0.0) {
                Err(Failure::BadInput(text)) => assert!(text.contains(says), "{text}"),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn the_receptor_stays_at_the_fold_or_comes_to_the_nipple_with_the_paddle() {
        // Skin from z = -10 to 20 mm, the nipple at 5 mm, the fold at -14 mm.
        let stop = "{ thickness_mm = 20.0 }";
        let of = |more: &str, fold_mm: f64| closing(&format!("{stop}\n{more}"), 30.0, fold_mm);
        let nipple = of("", -14.0).unwrap();
        assert_eq!(
            (nipple.receptor_mm, nipple.thickness_mm, nipple.receptor_share),
            (-10.0, 30.0, 0.5)
        );
        let fold = of("receptor = \"fold\"", -14.0).unwrap();
        assert_eq!((fold.receptor_mm, fold.thickness_mm, fold.receptor_share), (-14.0, 34.0, 0.0));
        let raised = of("receptor = \"fold\"\nreceptor_lift_mm = 3.0", -14.0).unwrap();
        assert_eq!((raised.receptor_mm, raised.thickness_mm), (-11.0, 31.0));
        assert_eq!(raised.lift_mm, 0.0);
        // It lifts a breast whose skin hangs lower than the fold, from that skin on, the paddle out of its way.
        for (more, fold_mm) in [("", -2.0), ("\nreceptor_lift_mm = 12.0", -14.0)] {
            let lifts = of(&format!("receptor = \"fold\"{more}"), fold_mm).unwrap();
            assert_eq!((lifts.receptor_mm, lifts.thickness_mm, lifts.lift_mm), (-10.0, 38.0, 8.0));
        }
        // Lifts that would leave the breast are refused, not cut short.
        for (receptor, lift_mm, what) in [
            ("fold", 40.0, "bring the receptor 6 mm above"),
            ("nipple", 20.0, "bring the middle between the plates 5 mm above"),
            ("nipple", -18.0, "bring the middle between the plates 3 mm below"),
        ] {
            let text = format!("receptor = \"{receptor}\"\nreceptor_lift_mm = {lift_mm:?}");
            match of(&text, -14.0) {
                Err(Failure::BadInput(text)) => assert!(text.contains(what), "{text}"),
                other => panic!("{other:?}"),
            }
        }
    }
}
