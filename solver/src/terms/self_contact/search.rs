//! Which face a node of the skin is over.

use super::plane::{distance_mm, foot};
use mammotwin_data::Vec3;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// A node that is nearer (mm) to the front of a face is watched.
const REACH_MM: f64 = 4.0;
/// A node that is deeper (mm) behind a face has not come through it.
const DEPTH_MM: f64 = 30.0;
/// Skins that touch look at each other: largest cosine between their normals.
const OPPOSED: f64 = -0.2;
/// Barycentric coordinate down to which a node stays over its face.
const BEYOND: f64 = -0.05;
/// No tissue is thinner (mm) than this: a node that is less deep behind a face has come through it.
const THIN_MM: f64 = 0.05;

/// The skin and the tissue under it.
pub(super) struct Skin {
    pub faces: Vec<[u32; 3]>,
    pub tets: Vec<[u32; 4]>,
    /// The nodes that may touch a face.
    pub nodes: Vec<u32>,
    /// The nodes of the faces of each of them.
    around: Vec<BTreeSet<u32>>,
}

/// The skin at one moment.
struct Now<'a> {
    skin: &'a Skin,
    points: &'a [Vec3],
    /// Unit normals of the faces, and of all nodes that have one.
    faces: Vec<Vec3>,
    nodes: Vec<Vec3>,
    /// Middle of each face along z, sorted, with its number; and how far the corners of any are from it.
    along: Vec<(f64, u32)>,
    widest_mm: f64,
    /// How far (mm) a corner of a tetrahedron is from its first one along z, at most.
    highest_mm: f64,
}

impl Skin {
    pub fn new(faces: &[[u32; 3]], tets: &[[u32; 4]], nodes: &[u32]) -> Self {
        let highest = faces.iter().flatten().max().map_or(0, |&n| n as usize + 1);
        let mut around = vec![BTreeSet::new(); highest];
        for face in faces {
            for &n in face {
                around[n as usize].extend(face);
            }
        }
        let around = nodes.iter().map(|&n| around[n as usize].clone()).collect();
        Self { faces: faces.to_vec(), tets: tets.to_vec(), nodes: nodes.to_vec(), around }
    }

    /// The face that each node is over with all nodes at `points` (mm), from those that they were over.
    pub fn over(&self, points: &[Vec3], before: &[Option<u32>]) -> Vec<Option<u32>> {
        let now = Now::new(self, points);
        let one = |element: usize| {
            let stays = before[element].filter(|&face| now.stays(element, face));
            stays.or_else(|| now.nearest(element))
        };
        (0..self.nodes.len()).into_par_iter().map(one).collect()
    }

    /// A node of the skin and the corners of a face (mm).
    pub fn pair(&self, element: usize, face: u32, points: &[Vec3]) -> [Vec3; 4] {
        let [a, b, c] = self.faces[face as usize];
        [self.nodes[element], a, b, c].map(|n| points[n as usize])
    }
}

impl<'a> Now<'a> {
    fn new(skin: &'a Skin, points: &'a [Vec3]) -> Self {
        let mut nodes = vec![Vec3::zeros(); points.len()];
        let (mut faces, mut along) = (Vec::new(), Vec::new());
        let mut widest_mm: f64 = 0.0;
        for (number, face) in skin.faces.iter().enumerate() {
            let [a, b, c] = face.map(|n| points[n as usize]);
            let vector = (b - a).cross(&(c - a));
            face.iter().for_each(|&n| nodes[n as usize] += vector);
            faces.push(unit(vector));
            let middle = (a + b + c) / 3.0;
            let wide = [a, b, c].map(|p| (p - middle).norm());
            widest_mm = wide.into_iter().fold(widest_mm, f64::max);
            along.push((middle.z, number as u32));
        }
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        nodes.iter_mut().for_each(|normal| *normal = unit(*normal));
        let z = |n: u32| points[n as usize].z;
        let heights = skin.tets.iter().flat_map(|t| t.map(|n| (z(n) - z(t[0])).abs()));
        let highest_mm = heights.fold(0.0, f64::max);
        Self { skin, points, faces, nodes, along, widest_mm, highest_mm }
    }

    /// Whether a node is still over its face.
    fn stays(&self, element: usize, face: u32) -> bool {
        let pair = self.skin.pair(element, face, self.points);
        let opposed = self.normal(element).dot(&self.faces[face as usize]) < 0.0;
        let mm = distance_mm(&pair);
        opposed && (-DEPTH_MM..2.0 * REACH_MM).contains(&mm) && is_over(&pair)
    }

    fn normal(&self, element: usize) -> Vec3 {
        self.nodes[self.skin.nodes[element] as usize]
    }

    /// The nearest face that a node is over, or has come through.
    fn nearest(&self, element: usize) -> Option<u32> {
        let node = self.skin.nodes[element];
        let place = self.points[node as usize];
        let far = DEPTH_MM + self.widest_mm;
        let first = self.along.partition_point(|(z, _)| *z < place.z - far);
        let last = self.along.partition_point(|(z, _)| *z <= place.z + far);
        let mut best: Option<(f64, u32)> = None;
        for &(_, face) in &self.along[first..last] {
            let corners = self.skin.faces[face as usize];
            if !(self.normal(element).dot(&self.faces[face as usize]) < OPPOSED)
                || (self.points[corners[0] as usize] - place).norm() > far + self.widest_mm
                || corners.iter().any(|n| self.skin.around[element].contains(n))
            {
                continue;
            }
            let pair = self.skin.pair(element, face, self.points);
            let mm = distance_mm(&pair);
            let near = (-DEPTH_MM..REACH_MM).contains(&mm) && is_over(&pair);
            if near && best.is_none_or(|(least, _)| mm.abs() < least) {
                best = Some((mm.abs(), face));
            }
        }
        let (_, face) = best?;
        // A face behind a node may also be the other side of its own tissue.
        let before = distance_mm(&self.skin.pair(element, face, self.points)) > -THIN_MM;
        (before || self.is_in_tissue(&(place + 0.5 * THIN_MM * self.normal(element))))
            .then_some(face)
    }

    /// Whether a point (mm) lies within a tetrahedron.
    fn is_in_tissue(&self, point: &Vec3) -> bool {
        let near =
            |tet: &&[u32; 4]| (self.points[tet[0] as usize].z - point.z).abs() <= self.highest_mm;
        self.skin.tets.iter().filter(near).any(|tet| {
            let [a, b, c, d] = tet.map(|n| self.points[n as usize] - point);
            let volumes = [
                b.cross(&c).dot(&d),
                -a.cross(&c).dot(&d),
                a.cross(&b).dot(&d),
                -a.cross(&b).dot(&c),
            ];
            volumes.iter().all(|v| *v > 0.0) || volumes.iter().all(|v| *v < 0.0)
        })
    }
}

fn is_over(pair: &[Vec3; 4]) -> bool {
    foot(pair).into_iter().all(|part| part >= BEYOND)
}

fn unit(vector: Vec3) -> Vec3 {
    vector.try_normalize(0.0).unwrap_or_else(Vec3::zeros)
}
