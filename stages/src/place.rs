//! A point of tissue in every shape that a study computed: stress-free, in each pose, between the plates.
//!
//! A point is held by its element and its barycentric coordinates there; both stay while the tissue moves.

use crate::{calibrate::Fit, compress::Compression};
use mammotwin_data::{
    Vec3,
    labels::Side,
    mesh::TetMesh,
    rigid::RigidTransform,
    surface::{TriMesh, barycentric},
};
use mammotwin_solver::{
    distance::SurfaceIndex,
    mesh::locate::{Location, Locator},
};
use std::collections::BTreeMap;

/// Points this near (mm) to the tissue are taken for its surface: segmentation and mesh smooth it.
pub const SNAP_MM: f64 = 5.0;

/// Node positions of all shapes of one model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shapes {
    /// Free of stress (mm), in the frame of the reference pose.
    pub rest: Vec<Vec3>,
    /// Poses by name (mm), in the same frame.
    pub poses: BTreeMap<String, Vec<Vec3>>,
    /// One breast between the plates.
    pub pressed: Option<Pressed>,
}

/// Nodes of a compressed part, in the frame of the detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Pressed {
    /// Where the compression began (mm).
    pub start: Vec<Vec3>,
    /// Where it ended (mm).
    pub points: Vec<Vec3>,
    /// From the frame of the reference pose.
    pub to_detector: RigidTransform,
}

impl Pressed {
    /// Of a compression.
    pub fn of(compression: &Compression) -> Self {
        Self {
            start: compression.mesh.points.clone(),
            points: compression.solution.points.clone(),
            to_detector: compression.to_detector,
        }
    }
}

impl Shapes {
    /// Of a fit and, where there is one, a compression.
    pub fn of(fit: &Fit, compression: Option<&Compression>) -> Self {
        let points =
            |pose: &crate::pose::PoseFit| (pose.pose.clone(), pose.solution.points.clone());
        Self {
            rest: fit.rest.clone(),
            poses: fit.poses.iter().map(points).collect(),
            pressed: compression.map(Pressed::of),
        }
    }
}

/// A shape of a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Shape {
    /// Free of stress.
    Free,
    /// A pose.
    Pose(String),
    /// Between the plates.
    Pressed,
}

/// Where a point of tissue is.
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    /// The breast that the tissue belongs to.
    pub side: Side,
    /// How far (mm) the point that was asked for lies outside of the tissue; its surface was taken.
    pub outside_mm: f64,
    /// Free of stress (mm), in the frame of the reference pose.
    pub rest: Vec3,
    /// In the poses (mm), in the same frame.
    pub poses: BTreeMap<String, Vec3>,
    /// Between the plates (mm), in the frame of the detector; `None` where that part is not pressed.
    pub pressed: Option<Vec3>,
}

/// Why a point has no place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unplaced {
    /// It is not in the tissue.
    #[error("lies {mm:.1} mm outside of the meshed breasts; the nearest point of them is ({:.1}, {:.1}, {:.1}) mm", nearest.x, nearest.y, nearest.z)]
    Outside {
        /// Distance (mm).
        mm: f64,
        /// The nearest point (mm), in the frame of the question.
        nearest: Vec3,
    },
    /// The shape was not computed.
    #[error("there is no such shape: {0}")]
    NoShape(String),
}

/// Finds points in one shape of a mesh, and on its surface.
pub struct Finder {
    locator: Locator,
    surface: Option<SurfaceIndex>,
    faces: Vec<[u32; 3]>,
    points: Vec<Vec3>,
    tets: Vec<[u32; 4]>,
}

impl Finder {
    /// For a mesh with its nodes at `points` (mm).
    pub fn new(mesh: &TetMesh, points: &[Vec3]) -> Self {
        let faces = mesh.outer_surface().triangles;
        let surface = TriMesh { points: points.to_vec(), triangles: faces.clone() };
        Self {
            locator: Locator::new(points, &mesh.tets),
            surface: SurfaceIndex::new(&surface).ok(),
            faces,
            points: points.to_vec(),
            tets: mesh.tets.clone(),
        }
    }

    /// The element that holds a point, or the one under the nearest point of the surface, with the distance
    /// (mm) to it; `None` for a point or a mesh without meaning.
    pub fn find(&self, p: &Vec3) -> Option<(Location, f64)> {
        if let Some(location) = self.locator.find(p) {
            return Some((location, 0.0));
        }
        let closest = self.surface.as_ref()?.closest(p)?;
        let face = self.faces[closest.triangle];
        let holds = |tet: &[u32; 4]| face.iter().all(|n| tet.contains(n));
        let tet = self.tets.iter().position(holds)?;
        let of_face = barycentric(face.map(|n| self.points[n as usize]), &closest.point);
        let weight =
            |n: &u32| face.iter().position(|corner| corner == n).map_or(0.0, |k| of_face[k]);
        let weights = self.tets[tet].each_ref().map(weight);
        Some((Location { tet: tet as u32, weights }, closest.distance_mm))
    }
}

/// A mesh, its compressed part, and the shapes of one model.
#[derive(Debug, Clone, Copy)]
pub struct Carrier<'a> {
    /// Both breasts.
    pub mesh: &'a TetMesh,
    /// The part that is compressed.
    pub part: Option<&'a TetMesh>,
    /// Pose in which the compression starts; the stress-free shape where `None`.
    pub start_pose: Option<&'a str>,
    /// Node positions.
    pub shapes: &'a Shapes,
}

impl Carrier<'_> {
    fn nodes(&self, shape: &Shape) -> Result<&[Vec3], Unplaced> {
        match shape {
            Shape::Free => Ok(&self.shapes.rest),
            Shape::Pose(name) => self
                .shapes
                .poses
                .get(name)
                .map(Vec::as_slice)
                .ok_or_else(|| Unplaced::NoShape(name.clone())),
            Shape::Pressed => self
                .shapes
                .pressed
                .as_ref()
                .map(|pressed| &pressed.points[..])
                .ok_or_else(|| Unplaced::NoShape("the compressed breast".into())),
        }
    }

    fn start(&self) -> Shape {
        self.start_pose.map_or(Shape::Free, |name| Shape::Pose(name.into()))
    }

    /// Carries points (mm) of one shape to all: in the frame of the detector for a compressed breast, in that of
    /// the reference pose otherwise.
    ///
    /// # Errors
    /// For each point that is more than [`SNAP_MM`] outside of the tissue.
    pub fn carry(&self, from: &Shape, points: &[Vec3]) -> Vec<Result<Places, Unplaced>> {
        let all = |error: Unplaced| points.iter().map(|_| Err(error.clone())).collect();
        let start = match self.nodes(&self.start()) {
            Ok(nodes) => nodes,
            Err(error) => return all(error),
        };
        let asked = match self.nodes(from) {
            Ok(nodes) => nodes,
            Err(error) => return all(error),
        };
        let to_start = self.part.zip(self.shapes.pressed.as_ref());
        let in_part =
            to_start.map(|(part, pressed)| (part, pressed, Finder::new(part, &pressed.start)));
        let is_pressed = *from == Shape::Pressed;
        let source = match (is_pressed, self.part) {
            (true, Some(part)) => Finder::new(part, asked),
            _ => Finder::new(self.mesh, asked),
        };
        let whole_start = is_pressed.then(|| Finder::new(self.mesh, start));
        let one = |p: &Vec3| -> Result<Places, Unplaced> {
            let outside = Unplaced::Outside { mm: f64::NAN, nearest: *p };
            let (found, outside_mm) = source.find(p).ok_or(outside.clone())?;
            if outside_mm > SNAP_MM {
                let nearest = found.interpolate(&source.tets, &source.points);
                return Err(Unplaced::Outside { mm: outside_mm, nearest });
            }
            // The compressed part is a mesh of its own: the shape that it starts in joins both.
            let (location, pressed) = match (&in_part, &whole_start) {
                (Some((part, pressed, _)), Some(whole)) => {
                    let began = found.interpolate(&part.tets, &pressed.start);
                    let began = pressed.to_detector.inverse().point(&began);
                    let (location, _) = whole.find(&began).ok_or(outside)?;
                    (location, Some(found.interpolate(&part.tets, &pressed.points)))
                }
                (Some((part, pressed, finder)), None) => {
                    let began = found.interpolate(&self.mesh.tets, start);
                    let began = pressed.to_detector.point(&began);
                    let held = finder.find(&began).filter(|(_, off_mm)| *off_mm < 1e-3);
                    let place = held.map(|(at, _)| at.interpolate(&part.tets, &pressed.points));
                    (found, place)
                }
                (None, _) => (found, None),
            };
            let at = |nodes: &Vec<Vec3>| location.interpolate(&self.mesh.tets, nodes);
            let poses = self.shapes.poses.iter().map(|(name, nodes)| (name.clone(), at(nodes)));
            Ok(Places {
                side: self.mesh.tissues[location.tet as usize].side().unwrap_or(Side::Right),
                outside_mm,
                rest: at(&self.shapes.rest),
                poses: poses.collect(),
                pressed,
            })
        };
        points.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::{labels::Tissue, mesh::Patch};
    use mammotwin_solver::mesh::crop::crop;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A box from (-60, 0, -40) to (60, 60, 40) mm of cubes of 20 mm, six tetrahedra each (Kuhn 1960).
    fn brick() -> TetMesh {
        let size = [6_u32, 3, 4];
        let node = |[i, j, k]: [u32; 3]| i + (size[0] + 1) * (j + (size[1] + 1) * k);
        let mut mesh = TetMesh::default();
        for k in 0..=size[2] {
            for j in 0..=size[1] {
                for i in 0..=size[0] {
                    let [x, y, z] = [i, j, k].map(|n| 20.0 * f64::from(n));
                    mesh.points.push(Vec3::new(x - 60.0, y, z - 40.0));
                }
            }
        }
        let mut faces: BTreeMap<[u32; 3], ([u32; 3], usize)> = BTreeMap::new();
        for n in 0..size.iter().product::<u32>() {
            let cube = [n % size[0], n / size[0] % size[1], n / (size[0] * size[1])];
            for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                let mut at = cube;
                let mut tet = [node(at); 4];
                for (corner, axis) in (1..).zip(order) {
                    at[axis] += 1;
                    tet[corner] = node(at);
                }
                if TetMesh::tet_volume(&mesh.points, &tet) < 0.0 {
                    tet.swap(2, 3);
                }
                let x = tet.iter().map(|&n| mesh.points[n as usize].x).sum::<f64>();
                let side = if x > 0.0 { Tissue::AdiposeRight } else { Tissue::AdiposeLeft };
                mesh.tets.push(tet);
                mesh.tissues.push(side);
                let [a, b, c, d] = tet;
                for face in [[a, c, b], [a, b, d], [a, d, c], [b, c, d]] {
                    let mut key = face;
                    key.sort_unstable();
                    faces.entry(key).or_insert((face, 0)).1 += 1;
                }
            }
        }
        let outer = faces.into_values().filter(|(_, count)| *count == 1).map(|(face, _)| face);
        mesh.patches.insert(Patch::Skin, outer.collect());
        mesh
    }

    fn bent(p: &Vec3, size: f64) -> Vec3 {
        Vec3::new(p.x + size * 0.2 * p.y, p.y - size * 0.1 * p.z, p.z * (1.0 + 0.1 * size))
            + 3.0 * size * Vec3::new((0.02 * p.z).sin(), (0.02 * p.x).sin(), 0.0)
    }

    #[test]
    fn a_point_goes_through_all_shapes_and_comes_back() {
        let mesh = brick();
        assert!((mesh.volume_mm3() - 120.0 * 60.0 * 80.0).abs() < 1e-6);
        let part = crop(&mesh, Side::Right, 0.0, 0.0);
        let shape = |size: f64| mesh.points.iter().map(|p| bent(p, size)).collect::<Vec<_>>();
        let to_detector = RigidTransform::about(
            &Vec3::new(50.0, 80.0, 0.0),
            &Vec3::new(0.3, -0.2, 0.5),
            &Vec3::new(-40.0, 5.0, 20.0),
        );
        let rest = shape(0.0);
        let start: Vec<Vec3> = part.take(&rest).iter().map(|p| to_detector.point(p)).collect();
        let squeezed = |p: &Vec3| Vec3::new(1.2 * p.x, 1.1 * p.y, 0.7 * p.z);
        let shapes = Shapes {
            poses: [("prone".into(), shape(1.0)), ("supine".into(), shape(-0.7))].into(),
            pressed: Some(Pressed {
                points: start.iter().map(squeezed).collect(),
                start,
                to_detector,
            }),
            rest,
        };
        let carrier =
            Carrier { mesh: &mesh, part: Some(&part.mesh), start_pose: None, shapes: &shapes };
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut points = Vec::new();
        let mut lefts = 0;
        while points.len() < 200 {
            let tet = mesh.tets[random.random_range(0..mesh.tets.len())];
            let raw: [f64; 4] = std::array::from_fn(|_| 0.01 + random.random::<f64>());
            let sum: f64 = raw.iter().sum();
            let nodes = &shapes.poses["prone"];
            let p = tet.iter().zip(raw).map(|(&n, w)| w / sum * nodes[n as usize]).sum::<Vec3>();
            points.push(p);
        }
        let prone = Shape::Pose("prone".into());
        for (p, there) in points.iter().zip(carrier.carry(&prone, &points)) {
            let there = there.unwrap();
            assert!((there.poses["prone"] - p).norm() < 1e-9);
            let mut ways = vec![
                (Shape::Free, there.rest),
                (Shape::Pose("supine".into()), there.poses["supine"]),
            ];
            match there.pressed {
                Some(place) => {
                    ways.push((Shape::Pressed, place));
                    // The law of the squeezed shape is linear: it is known between the nodes, too.
                    let exact = squeezed(&to_detector.point(&there.rest));
                    assert!((place - exact).norm() < 1e-9);
                }
                None => lefts += 1,
            }
            for (shape, place) in ways {
                let back = carrier.carry(&shape, &[place]).remove(0).unwrap();
                let off = (back.poses["prone"] - p).norm();
                assert!(off < 1e-6 && back.outside_mm < 1e-6, "{shape:?}: {off} mm");
            }
        }
        assert!((20..180).contains(&lefts), "{lefts} of 200 are not in the compressed part");
    }

    #[test]
    fn a_point_in_the_air_is_refused_with_its_distance_and_one_near_the_skin_is_put_on_it() {
        let mesh = brick();
        let shapes = Shapes { rest: mesh.points.clone(), ..Shapes::default() };
        let carrier = Carrier { mesh: &mesh, part: None, start_pose: None, shapes: &shapes };
        let front = Vec3::new(7.0, 60.0, -11.0);
        let ask =
            |mm: f64| carrier.carry(&Shape::Free, &[front + Vec3::new(0.0, mm, 0.0)]).remove(0);
        let near = ask(2.0).unwrap();
        assert!((near.rest - front).norm() < 1e-9 && (near.outside_mm - 2.0).abs() < 1e-9);
        match ask(30.0) {
            Err(Unplaced::Outside { mm, nearest }) => {
                assert!((mm - 30.0).abs() < 1e-9 && (nearest - front).norm() < 1e-9);
            }
            other => panic!("{other:?}"),
        }
        let pressed = carrier.carry(&Shape::Pressed, &[front]).remove(0);
        assert!(matches!(pressed, Err(Unplaced::NoShape(_))), "{pressed:?}");
        assert!(carrier.carry(&Shape::Free, &[Vec3::repeat(f64::NAN)]).remove(0).is_err());
    }
}
