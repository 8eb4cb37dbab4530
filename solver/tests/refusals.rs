//! Models that cannot be solved are refused before the first step, each with its own error.

use crate::common;

use common::shapes::brick;
use mammotwin_data::{
    Mat3, Vec3,
    mesh::{Patch, TetMesh},
    progress::Silent,
    study::LawName,
};
use mammotwin_solver::assemble::AssemblyError;
use mammotwin_solver::compress::{
    Closing, Compressed, Plates, StopRule, StoppedEarly, Stops, compress,
};
use mammotwin_solver::materials::Law;
use mammotwin_solver::mesh::quadratic::QuadraticMesh;
use mammotwin_solver::paddles::{Outline, Paddle};
use mammotwin_solver::terms::{
    Bulk, Cables, Gravity, Membrane, QuadraticBulk, Sliding, Slip,
    quadratic::Rule,
    target::{Cylinder, Plane, Sphere, Target},
};
use mammotwin_solver::{Model, ModelError, Options, SolveError, solve};
use std::sync::Arc;

fn mesh() -> TetMesh {
    brick([2, 2, 2], |i, j, l| 10.0 * Vec3::new(i as f64, j as f64, l as f64))
}

fn law() -> Law {
    Law::new(LawName::NeoHookean, 1.0, 0.49, None).unwrap()
}

fn tissue(mesh: &TetMesh) -> Result<Bulk, ModelError> {
    Bulk::new("tissue", mesh, vec![law(); mesh.tets.len()])
}

/// Tissue under its weight, not held.
fn loose(mesh: &TetMesh) -> Result<Model, ModelError> {
    let mut model = Model::new(mesh);
    model.add(tissue(mesh)?)?;
    model.add(Gravity::new("gravity", mesh, 1.0, Vec3::z()))?;
    Ok(model)
}

fn solved(model: Result<Model, ModelError>, start: &[Vec3]) -> Result<(), SolveError> {
    let model = model.map_err(AssemblyError::from)?;
    solve(&model, start, &Options::default(), &Silent).map(|_| ())
}

/// The nodes that `which` picks, held in all directions.
fn held(mesh: &TetMesh, which: impl Fn(&Vec3) -> bool) -> Result<Model, ModelError> {
    let mut model = loose(mesh)?;
    for (n, _) in mesh.points.iter().enumerate().filter(|(_, p)| which(p)) {
        model.fix_node(n as u32);
    }
    Ok(model)
}

/// The mesh and the same again, 100 mm away.
fn twins() -> TetMesh {
    let mut both = mesh();
    let (nodes, tets) = (both.points.len() as u32, both.tets.clone());
    let second: Vec<Vec3> = both.points.iter().map(|p| p + 100.0 * Vec3::x()).collect();
    both.points.extend(second);
    both.tets.extend(tets.iter().map(|tet| tet.map(|n| n + nodes)));
    both.tissues = vec![both.tissues[0]; both.tets.len()];
    both
}

/// The mesh with its middle node at a place.
fn middle_at(place: Vec3) -> TetMesh {
    let mut mesh = mesh();
    mesh.points[13] = place;
    mesh
}

fn with(
    add: impl FnOnce(&mut Model, &TetMesh) -> Result<(), ModelError>,
) -> Result<(), SolveError> {
    let mesh = mesh();
    let model = held(&mesh, |p| p.z == 0.0).and_then(|mut model| {
        add(&mut model, &mesh)?;
        Ok(model)
    });
    solved(model, &mesh.points)
}

/// A compression whose plates begin at a distance (mm), of a body that is 20 mm high.
fn pressed(thickness_mm: f64) -> Result<(), SolveError> {
    closed(thickness_mm, Stops::at_thickness(thickness_mm - 1.0)).map(|_| ())
}

fn closed(thickness_mm: f64, stops: Stops) -> Result<Compressed, SolveError> {
    let mesh = mesh();
    let plates = Plates {
        axis: Vec3::z(),
        away: Vec3::x(),
        edge_mm: -1e3,
        radius_mm: 1.0,
        friction: 0.0,
        paddle: Paddle::Rigid,
        outline: Outline::ENDLESS,
        middle_mm: 0.0,
        faces: mesh.patch(Patch::Skin).to_vec(),
    };
    let closing = Closing {
        receptor_mm: 0.0,
        thickness_mm,
        receptor_share: 0.0,
        lift_mm: 0.0,
        step_mm: 2.0,
        stops,
    };
    let model = held(&mesh, |p| p.z == 0.0).unwrap();
    let options = Options::default();
    compress(model, &plates, &closing, &mesh.points, &options, &Silent)
}

/// Verifies: a body that begins between the plates, beyond a limit or at it | ends at once, by that limit | first state
#[test]
fn a_limit_that_the_first_state_is_beyond_ends_it_at_once() {
    let force = |force_mn: f64| Stops { force_mn: Some(force_mn), ..Stops::default() };
    let start = |stops: Stops| closed(19.0, stops).unwrap();
    let first = start(Stops::at_thickness(18.0)).steps.swap_remove(0);
    let force_mn = first.paddle_force_mn;
    assert!(force_mn > 1.0, "{force_mn} mN");
    // At it: met, in one state.
    let done = start(force(1.005 * force_mn));
    assert_eq!((done.steps.len(), done.met), (1, Some(StopRule::Force)));
    assert!(done.stopped_early.is_none());
    // Beyond it, by pressure or by force: said, and no leap.
    let peak = Some(0.5 * first.peak_pressure_kpa);
    for stops in [force(0.5 * force_mn), Stops { peak_pressure_kpa: peak, ..force(0.9 * force_mn) }]
    {
        let done = start(stops);
        assert_eq!((done.steps.len(), done.met), (1, None));
        let why = done.stopped_early.unwrap();
        let StoppedEarly::Beyond { share, .. } = why else { panic!("{why}") };
        assert!((share - 2.0).abs() < 1e-6 && why.to_string().contains("200 %"), "{why}");
    }
    // Below it: the plates close.
    let done = start(force(1.3 * force_mn));
    assert!(done.steps.len() > 1 && done.met == Some(StopRule::Force), "{:?}", done.stopped_early);
}

/// What is wrong, what the solver answers, which error it must be, and what it must tell.
type Row = (&'static str, Result<(), SolveError>, fn(&ModelError) -> bool, &'static [&'static str]);

#[test]
fn every_bad_model_is_refused_with_its_own_error() {
    use ModelError::{
        Count, Empty, Flat, Loose, NoSuchNode, Overlap, SameName, Thickness, Unheld, Value,
    };
    let mesh = mesh();
    let points = mesh.points.clone();
    let top = mesh.patch(Patch::Skin).to_vec();
    let skin = |thickness: f64| {
        with(|model, mesh| {
            let faces = mesh.patch(Patch::Skin);
            model.add(Membrane::uniform("skin", &mesh.points, faces, thickness, law())?)
        })
    };
    let plane = || Arc::new(Plane { point: Vec3::zeros(), normal: Vec3::z() });
    let tall = middle_at(Vec3::new(10.0, 10.0, 60.0));
    let nowhere = middle_at(Vec3::new(10.0, f64::NAN, 10.0));
    let quadratic = |mesh: &TetMesh| {
        let fine = QuadraticMesh::new(mesh);
        let laws = vec![law(); fine.tets.len()];
        let term = QuadraticBulk::new("fine", &fine, laws, Rule::Four);
        term.map(|_| ()).map_err(|error| AssemblyError::from(error).into())
    };
    let both = twins();
    let beside = {
        let mut mesh = mesh.clone();
        mesh.points.push(Vec3::new(50.0, 0.0, 0.0));
        mesh
    };
    let rows: [Row; 20] = [
        (
            "nothing holds it",
            solved(loose(&mesh), &points),
            |e| matches!(e, Unheld { motions: 6, of: 6, nodes: 27, node: 0, .. }),
            &["6 of 6", "fix more"],
        ),
        (
            "one node holds it",
            solved(held(&mesh, |p| *p == Vec3::zeros()), &points),
            |e| matches!(e, Unheld { motions: 3, .. }),
            &["3 of 6"],
        ),
        (
            "one edge holds it",
            solved(held(&mesh, |p| p.x == 0.0 && p.y == 0.0), &points),
            |e| matches!(e, Unheld { motions: 1, .. }),
            &["1 of 6"],
        ),
        (
            "a part is loose",
            solved(held(&both, |p| p.x == 0.0), &both.points),
            |e| matches!(e, Unheld { motions: 6, nodes: 27, node: 27, .. }),
            &["node 27", "100.0"],
        ),
        (
            "a node without tissue",
            solved(held(&beside, |p| p.z == 0.0 && p.x < 30.0), &beside.points),
            |e| matches!(e, Loose { node: 27, .. }),
            &["node 27", "no tissue"],
        ),
        (
            "no tetrahedra",
            with(|model, _| model.add(Bulk::new("more", &TetMesh::default(), Vec::new())?)),
            |e| matches!(e, Empty(term) if term == "more"),
            &["more", "no element"],
        ),
        (
            "no faces of skin",
            with(|model, mesh| {
                model.add(Membrane::uniform("skin", &mesh.points, &[], 2.0, law())?)
            }),
            |e| matches!(e, Empty(term) if term == "skin"),
            &["skin"],
        ),
        (
            "no faces of contact",
            with(|model, mesh| model.add(Sliding::new("wall", &mesh.points, &[], plane()))),
            |e| matches!(e, Empty(term) if term == "wall"),
            &["wall"],
        ),
        (
            "no cables",
            with(|model, _| model.add(Cables::new("cables", Vec::new())?)),
            |e| matches!(e, Empty(term) if term == "cables"),
            &["cables"],
        ),
        (
            "plates that overlap the body",
            pressed(8.0),
            |e| matches!(e, Overlap { depth_mm, .. } if (depth_mm - 12.0).abs() < 1e-9),
            &["paddle", "12.0 mm", "farther apart"],
        ),
        (
            "an element inside out",
            solved(held(&tall, |p| p.z == 0.0), &tall.points),
            |e| matches!(e, Flat { size, .. } if *size < 0.0),
            &["tissue", "element", "improve the mesh"],
        ),
        (
            "a quadratic element inside out",
            quadratic(&tall),
            |e| matches!(e, Flat { .. }),
            &["fine"],
        ),
        (
            "a node that is no number",
            solved(held(&nowhere, |p| p.z == 0.0), &nowhere.points),
            |e| matches!(e, Flat { size, .. } if size.is_nan()),
            &["NaN"],
        ),
        ("its quadratic element", quadratic(&nowhere), |e| matches!(e, Flat { .. }), &["fine"]),
        (
            "a node without tissue that is no number",
            {
                let mut far = beside.clone();
                far.points[27].y = f64::NAN;
                solved(held(&far, |p| p.z == 0.0), &far.points)
            },
            |e| matches!(e, ModelError::NotFinite { node: 27, .. }),
            &["node 27", "NaN", "finite"],
        ),
        (
            "skin without thickness",
            skin(0.0),
            |e| matches!(e, Thickness { element: 0, .. }),
            &["0 mm"],
        ),
        ("skin of negative thickness", skin(-1.0), |e| matches!(e, Thickness { .. }), &["-1 mm"]),
        (
            "too few laws",
            with(|model, mesh| model.add(Bulk::new("more", mesh, vec![law()])?)),
            |e| matches!(e, Count { got: 1, .. }),
            &["1 laws for 48"],
        ),
        (
            "faces of another mesh",
            with(|model, mesh| {
                let shift = top.iter().map(|face| face.map(|n| n + 10)).collect::<Vec<_>>();
                let far = [mesh.points.clone(), mesh.points.clone()].concat();
                model.add(Membrane::uniform("skin", &far, &shift, 2.0, law())?)
            }),
            |e| matches!(e, NoSuchNode { .. }),
            &["of 27"],
        ),
        (
            "two terms of one name",
            with(|model, mesh| model.add(tissue(mesh)?)),
            |e| matches!(e, SameName(_) | Value { .. }),
            &["tissue"],
        ),
    ];
    for (name, answer, is_it, told) in rows {
        let Err(error) = answer else { panic!("{name}: not refused") };
        let text = error.to_string();
        println!("{name}: {text}");
        let SolveError::Assembly(AssemblyError::Model(error)) = &error else {
            panic!("{name}: {error:?}")
        };
        assert!(is_it(error), "{name}: {error:?}");
        assert!(told.iter().all(|part| text.contains(part)), "{name}: {text}");
    }
}

#[test]
fn starts_without_a_place_are_refused() {
    let mesh = mesh();
    let model = held(&mesh, |p| p.z == 0.0).unwrap();
    let mut start = mesh.points.clone();
    start[20].x = f64::NAN;
    let error = solve(&model, &start, &Options::default(), &Silent).unwrap_err();
    assert!(matches!(error, SolveError::NotFinite { node: 20, .. }), "{error:?}");
    assert!(error.to_string().contains("node 20"), "{error}");
    start.pop();
    let error = solve(&model, &start, &Options::default(), &Silent).unwrap_err();
    assert!(matches!(error, SolveError::Start { wanted: 27, got: 26 }), "{error:?}");
}

#[test]
fn bodies_that_are_held_just_enough_are_solved() {
    // Three symmetry planes.
    let mesh = mesh();
    let mut model = loose(&mesh).unwrap();
    for (n, p) in mesh.points.iter().enumerate() {
        for axis in (0..3).filter(|&axis| p[axis] == 0.0) {
            model.fix(n as u32, axis);
        }
    }
    solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
    // Six coordinates of three nodes.
    let mut model = loose(&mesh).unwrap();
    for (node, axes) in [(0, &[0, 1, 2][..]), (2, &[0, 2]), (6, &[2])] {
        axes.iter().for_each(|&axis| model.fix(node, axis));
    }
    let refused = solve(&model, &mesh.points, &Options::default(), &Silent).err();
    assert!(!matches!(refused, Some(SolveError::Assembly(_))), "{refused:?}");
    // Plates a little inside of the skin.
    pressed(18.5).unwrap();
}

/// Tissue under gravity along `direction` on a smooth surface that it cannot leave.
fn on(target: Arc<dyn Target>, direction: Vec3, slip: Slip) -> Result<(), SolveError> {
    let mesh = mesh();
    let model = tissue(&mesh).and_then(|tissue| {
        let mut model = Model::new(&mesh);
        model.add(tissue)?;
        model.add(Gravity::new("gravity", &mesh, 1.0, direction))?;
        let faces = mesh.patch(Patch::ChestWall);
        let wall = Sliding::new("wall", &mesh.points, faces, target);
        model.add(wall.slip(slip, &mesh.points)?)?;
        Ok(model)
    });
    solved(model, &mesh.points)
}

/// Verifies: rigid motions that a smooth plane, cylinder and sphere leave free | closed form: 3, 2, 3 | exact
#[test]
fn smooth_surfaces_hold_along_their_normals_alone() {
    let plane = || Arc::new(Plane { point: Vec3::zeros(), normal: Vec3::z() });
    let middle = Vec3::new(10.0, 10.0, -50.0);
    let cylinder = || Arc::new(Cylinder { point: middle, axis: Vec3::y(), radius_mm: 50.0 });
    let sphere = || Arc::new(Sphere { center: middle, radius_mm: 50.0 });
    let (down, aside) = (-Vec3::z(), Vec3::new(0.3, 0.0, -1.0));
    for (name, answer, free) in [
        ("plane, down", on(plane(), down, Slip::Free), 3),
        ("plane, aside", on(plane(), aside, Slip::Free), 3),
        ("cylinder", on(cylinder(), down, Slip::Free), 2),
        ("sphere", on(sphere(), down, Slip::Free), 3),
    ] {
        let Err(SolveError::Assembly(AssemblyError::Model(error))) = answer else {
            panic!("{name}: {answer:?}")
        };
        println!("{name}: {error}");
        assert!(
            matches!(error, ModelError::Unheld { motions, of: 6, .. } if motions == free),
            "{name}: {error:?}"
        );
        assert!(error.to_string().contains("friction"), "{error}");
    }
    // Friction may hold it, and a wall that is bent in all directions does.
    on(plane(), down, Slip::Coulomb(0.3)).unwrap();
    on(plane(), down, Slip::Never).unwrap();
    let bent = on(Arc::new(Saddle), down, Slip::Free);
    assert!(!matches!(bent, Err(SolveError::Assembly(_))), "{bent:?}");
}

/// z = 2 sin(x/6) sin(y/6) - 2, to first order in its height.
struct Saddle;

impl Target for Saddle {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        let ((sx, cx), (sy, cy)) = ((point.x / 6.0).sin_cos(), (point.y / 6.0).sin_cos());
        let slope = Vec3::new(-cx * sy / 3.0, -sx * cy / 3.0, 1.0);
        let (d, m) = (sx * sy / 18.0, -cx * cy / 18.0);
        let curvature = Mat3::new(d, m, 0.0, m, d, 0.0, 0.0, 0.0, 0.0);
        (point.z - 2.0 * sx * sy + 2.0, slope, curvature)
    }
}
