//! A breast-like body on a cylindrical chest wall of radius 150 mm, in two mesh densities.
//!
//! Little-endian files: counts of nodes, tetrahedra, base faces, skin faces and rim nodes and the
//! nipple's node as u32, node positions (mm) as f32, then all indices as u16.

#![allow(dead_code)] // benches take a part of it

pub mod contact;
pub mod laws;
pub mod loads;
pub mod shapes;
pub mod squeeze;

use mammotwin_data::{Vec3, labels::Tissue, mesh::Patch, mesh::TetMesh};
use mammotwin_solver::{
    Model,
    materials::Law,
    terms::{Bulk, Gravity},
};
use std::collections::BTreeMap;

pub struct Body {
    pub mesh: TetMesh,
    pub rim: Vec<u32>,
    pub nipple: usize,
}

pub fn coarse() -> Body {
    read(include_bytes!("../data/b5k.bin"))
}

pub fn fine() -> Body {
    read(include_bytes!("../data/b20k.bin"))
}

/// The coarse body on a fixed base, hanging.
pub fn hanging(law: Law) -> Model {
    let Body { mesh, .. } = coarse();
    let mut model = Model::new(&mesh);
    model.add(Bulk::new("breast", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    model.add(Gravity::new("gravity", &mesh, 0.98, Vec3::z())).unwrap();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    model
}

fn read(bytes: &[u8]) -> Body {
    let u32_at =
        |n: usize| u32::from_le_bytes(bytes[4 * n..4 * n + 4].try_into().unwrap()) as usize;
    let [nodes, tets, base, skin, rim, nipple] = [0, 1, 2, 3, 4, 5].map(u32_at);
    let floats = bytes[24..24 + 12 * nodes].chunks(4);
    let floats: Vec<f64> =
        floats.map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    let mut indices = bytes[24 + 12 * nodes..]
        .chunks(2)
        .map(|b| u32::from(u16::from_le_bytes(b.try_into().unwrap())));
    let mut next = || indices.next().unwrap();
    let tets: Vec<[u32; 4]> = (0..tets).map(|_| [next(), next(), next(), next()]).collect();
    let mut faces =
        |count: usize| -> Vec<[u32; 3]> { (0..count).map(|_| [next(), next(), next()]).collect() };
    let patches = BTreeMap::from([(Patch::ChestWall, faces(base)), (Patch::Skin, faces(skin))]);
    Body {
        mesh: TetMesh {
            points: floats.chunks(3).map(Vec3::from_column_slice).collect(),
            tissues: vec![Tissue::AdiposeRight; tets.len()],
            tets,
            patches,
        },
        rim: (0..rim).map(|_| next()).collect(),
        nipple,
    }
}

/// How rough a nodal field is: mean square difference of neighbours over the variance. A field
/// that is smooth over the mesh has less the finer the mesh is; a checkerboard has 2 or more.
pub fn roughness(mesh: &TetMesh, field: &[f64]) -> f64 {
    let (mut sum, mut pairs) = (0.0, 0.0);
    for tet in &mesh.tets {
        for [a, b] in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
            sum += (field[tet[a] as usize] - field[tet[b] as usize]).powi(2);
            pairs += 1.0;
        }
    }
    let mean = field.iter().sum::<f64>() / field.len() as f64;
    let variance = field.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / field.len() as f64;
    sum / pairs / variance
}
