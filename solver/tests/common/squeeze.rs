//! The breast-like body between two plates, 132 mm apart at first.

use super::Body;
use mammotwin_data::{Vec3, mesh::Patch, mesh::TetMesh, progress::Silent};
use mammotwin_solver::assemble::{Assembly, State};
use mammotwin_solver::compress::{Closing, Compressed, Plates, Stops, compress};
use mammotwin_solver::materials::Law;
use mammotwin_solver::paddles::{Outline, Paddle};
use mammotwin_solver::terms::{Bulk, Load};
use mammotwin_solver::{Model, Options};

/// Where the plates' edges are, from the base (mm).
pub const EDGE_MM: f64 = 20.0;

/// How it is squeezed.
pub struct Squeeze {
    pub law: Law,
    pub radius_mm: f64,
    pub paddle: Paddle,
    pub outline: Outline,
    pub middle_mm: f64,
    pub friction: f64,
    pub step_mm: f64,
    pub stops: Stops,
}

impl Squeeze {
    /// Rigid, endless and smooth plates with edges of 10 mm.
    pub fn rigid(law: Law, step_mm: f64, goal_mm: f64) -> Self {
        Self {
            law,
            radius_mm: 10.0,
            paddle: Paddle::Rigid,
            outline: Outline::ENDLESS,
            middle_mm: 0.0,
            friction: 0.0,
            step_mm,
            stops: Stops::at_thickness(goal_mm),
        }
    }

    /// The plates against the skin of a body.
    pub fn plates(&self, body: &Body) -> Plates {
        Plates {
            axis: Vec3::y(),
            away: Vec3::z(),
            edge_mm: EDGE_MM,
            radius_mm: self.radius_mm,
            friction: self.friction,
            paddle: self.paddle.clone(),
            outline: self.outline,
            middle_mm: self.middle_mm,
            faces: body.mesh.patch(Patch::Skin).to_vec(),
        }
    }

    /// Both plates come alike.
    pub fn closing(&self) -> Closing {
        Closing {
            receptor_mm: -66.0,
            thickness_mm: 132.0,
            receptor_share: 0.5,
            lift_mm: 0.0,
            step_mm: self.step_mm,
            stops: self.stops,
        }
    }

    /// Closes the plates on a body that is held at its chest wall.
    pub fn press(&self, body: &Body) -> Compressed {
        let mesh = &body.mesh;
        let mut model = Model::new(mesh);
        let laws = vec![self.law; mesh.tets.len()];
        model.add(Bulk::new("breast", mesh, laws).unwrap()).unwrap();
        for node in mesh.patch_nodes(Patch::ChestWall) {
            model.fix_node(node);
        }
        let plates = self.plates(body);
        let options = Options::default();
        compress(model, &plates, &self.closing(), &mesh.points, &options, &Silent).unwrap()
    }

    /// The same, and says how.
    pub fn run(&self, body: &Body) -> Compressed {
        let clock = std::time::Instant::now();
        let done = self.press(body);
        for step in &done.steps {
            println!(
                "{:6.1} mm {:6.2}° {:6.2}° {:.2} mm {:.4} N {:.4} N, {:.0} and {:.0} mm², {:.3} kPa, moved {:.2} mm",
                step.thickness_mm,
                step.tilt_rad.to_degrees(),
                step.roll_rad.to_degrees(),
                step.deflection_mm,
                step.paddle_force_mn / 1e3,
                step.receptor_force_mn / 1e3,
                step.contact_area_mm2,
                step.front_area_mm2,
                step.mean_pressure_kpa,
                step.moved_mm,
            );
        }
        let Compressed { stopped_early, met, solution, .. } = &done;
        println!("{:?}: {met:?} {stopped_early:?} {:?}", clock.elapsed(), solution.checks);
        done
    }
}

/// A block of 20 mm between plates that reach beyond it and close to 14 mm.
pub fn flat(mesh: &TetMesh, law: Law, friction: f64) -> (Plates, Compressed) {
    let mut model = Model::new(mesh);
    model.add(Bulk::new("block", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    // So that a block without friction has a place.
    let first = mesh.patch_nodes(Patch::ChestWall)[0];
    model.fix(first, 0);
    model.fix(first, 1);
    model.fix(1, 0);
    let faces = [Patch::ChestWall, Patch::Skin].iter().flat_map(|&p| mesh.patch(p)).copied();
    let plates = Plates {
        axis: Vec3::z(),
        away: Vec3::x(),
        edge_mm: -1e3,
        radius_mm: 1.0,
        friction,
        paddle: Paddle::Rigid,
        outline: Outline::ENDLESS,
        middle_mm: 0.0,
        faces: faces.collect(),
    };
    let closing = Closing {
        receptor_mm: 0.0,
        thickness_mm: 20.0,
        receptor_share: 0.0,
        lift_mm: 0.0,
        step_mm: 2.0,
        stops: Stops::at_thickness(14.0),
    };
    let options = Options::default();
    let done = compress(model, &plates, &closing, &mesh.points, &options, &Silent).unwrap();
    (plates, done)
}

/// Forces (mN) on the nodes of a body at `points` by its tissue alone, as its gradient: what holds it has the opposite.
pub fn of_tissue(mesh: &TetMesh, law: Law, points: &[Vec3]) -> Vec<Vec3> {
    let mut model = Model::new(mesh);
    model.add(Bulk::new("tissue", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    let mut assembly = Assembly::new(&model).unwrap();
    let mut state = State::new(&model, points.to_vec(), Load::GRAVITY);
    let mut pressure = Vec::new();
    assembly.energy(&model, &state, points, &mut pressure).unwrap();
    state.pressure = pressure;
    assembly.term_gradients(&model, &state).unwrap().remove(0)
}
