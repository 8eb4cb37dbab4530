//! How far linear and quadratic elements are off on a volunteer's own shape, in millimetres of skin.

use mammotwin_data::{
    Vec3,
    mesh::Patch,
    progress::Silent,
    study::{Elements, MeshPlan},
    surface::TriMesh,
};
use mammotwin_solver::distance::SurfaceIndex;
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody};

/// Distances (mm) from the nipple between which skin is compared: the nipple itself is not resolved.
const AROUND_MM: [f64; 2] = [15.0, 55.0];

struct Posed {
    torso: Torso,
    skin: TriMesh,
    /// Nodes of the skin around the nipples.
    nodes: Vec<u32>,
}

fn prone(size_mm: f64, elements: Elements) -> Posed {
    let torso = Torso::new(Preset::named("tiny").unwrap().person(3), 3);
    let body = TruthBody::new(&torso, MeshPlan { size_mm, elements }, &Silent).unwrap();
    let points = body.deform(PoseName::Prone, &Silent).unwrap().points;
    let around = |p: &Vec3| {
        let near = |apex: &Vec3| (AROUND_MM[0]..AROUND_MM[1]).contains(&(p - apex).norm());
        torso.breasts.iter().any(|breast| near(&breast.apex))
    };
    let nodes = body.mesh.patch_nodes(Patch::Skin);
    let nodes = nodes.into_iter().filter(|&n| around(&body.supine.points[n as usize])).collect();
    let skin = TriMesh { points, triangles: body.mesh.patch(Patch::Skin).to_vec() };
    Posed { torso, skin, nodes }
}

/// Mean and standard deviation (mm) of the signed distances of one skin's nodes to another skin.
fn off(from: &Posed, to: &Posed) -> [f64; 2] {
    assert_eq!(from.torso.seed(), to.torso.seed());
    let index = SurfaceIndex::new(&to.skin).unwrap();
    let points: Vec<Vec3> = from.nodes.iter().map(|&n| from.skin.points[n as usize]).collect();
    let closest = index.closest_of(&points).unwrap();
    let all: Vec<f64> = closest.iter().zip(&points).map(|(c, p)| c.signed_mm(p)).collect();
    let count = all.len() as f64;
    let mean = all.iter().sum::<f64>() / count;
    let square = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    [mean, square.sqrt()]
}

#[test]
#[ignore = "a minute: three truths"]
fn quadratic_elements_agree_where_linear_ones_are_off() {
    let [fine, coarse] = [13.0, 16.0].map(|size_mm| prone(size_mm, Elements::Quadratic));
    let linear = prone(13.0, Elements::Linear);
    let [mean, scatter] = off(&coarse, &fine);
    let [linear_mean, linear_scatter] = off(&fine, &linear);
    println!("16 to 13 mm {mean:.3} {scatter:.3}, linear {linear_mean:.3} {linear_scatter:.3}");
    // A truth has to be better than the 0.25 mm that the budget takes for noise.
    assert!(mean.abs() < 0.25 && scatter < 0.25, "{mean} {scatter}");
    assert!(linear_mean.hypot(linear_scatter) > 3.0 * mean.hypot(scatter));
}
