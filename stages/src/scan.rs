//! A pose that was measured as a surface: where it lies, and its skin.

use crate::{align::Start, model::Anatomy, register::Registered, surface::PoseSurfaces};
use mammotwin_data::{
    Failure, Vec3, landmarks::Landmarks, progress::Progress, store::Stage, study::ScanUnit,
    surface::TriMesh,
};
use serde::Serialize;
use std::collections::BTreeMap;

/// A fit of landmarks that is worse (mm, root mean square) is of other places.
const MISPLACED_MM: f64 = 15.0;

/// Places a scan by its landmarks on the chest wall: nothing else of it stays between the poses.
#[derive(Debug, Clone, Serialize)]
pub struct PlaceScan {
    /// Name of the pose.
    pub pose: String,
    /// Unit vector of gravity in the frame of the scan.
    pub gravity_in_scan: Vec3,
}

impl Stage for PlaceScan {
    const NAME: &'static str = "place_scan";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Scans of the skin were placed in the reference pose's frame by landmarks on the \
         chest wall, by least squares (Kabsch, Acta Cryst. A 32 (1976) 922).";
    /// Landmarks of the reference pose and of the scan.
    type Input = (Option<Landmarks>, Landmarks);
    type Output = Registered;

    fn run(&self, (reference, own): &Self::Input, _: &dyn Progress) -> Result<Registered, Failure> {
        let pose = &self.pose;
        let start = match reference {
            Some(reference) => Start::of_landmarks(reference, own)
                .map_err(|cause| Failure::BadInput(format!("scans.{pose}: {cause}")))?,
            None => None,
        };
        let start = start.ok_or_else(|| {
            Failure::BadInput(format!(
                "scans.{pose}: has fewer than three chest_... landmarks in common with the reference pose; a scan of the \
                 skin lies where they say"
            ))
        })?;
        if let Some(rms_mm) = start.landmark_rms_mm.filter(|mm| *mm > MISPLACED_MM) {
            return Err(Failure::BadInput(format!(
                "scans.{pose}: its chest_... landmarks are {rms_mm:.0} mm off those of the reference pose; are they in \
                 millimetres, and is none confused with another?"
            )));
        }
        let gravity = start.transform.direction(&self.gravity_in_scan).normalize();
        let transform = start.transform;
        Ok(Registered { transform, gravity, start, image: None, wall: None })
    }
}

/// The skin of a scan, in millimetres, with normals that point out of the body.
#[derive(Debug, Clone, Serialize)]
pub struct SkinScan {
    /// Units of the scan.
    pub unit: ScanUnit,
}

impl Stage for SkinScan {
    const NAME: &'static str = "skin_scan";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "";
    type Input = (TriMesh, Registered);
    type Output = PoseSurfaces;

    fn run(
        &self,
        (surface, registered): &Self::Input,
        _: &dyn Progress,
    ) -> Result<PoseSurfaces, Failure> {
        let mm = self.unit.in_mm();
        let points = surface.points.iter().map(|p| mm * p).collect();
        let mut skin = TriMesh { points, triangles: surface.triangles.clone() };
        // What a person shows a scanner faces forwards on the whole; a closed surface has a volume.
        let inside_out = if border(&skin).is_empty() {
            skin.volume_mm3() < 0.0
        } else {
            let forward = registered.transform.inverse().direction(&Vec3::y());
            (0..skin.triangles.len()).map(|t| skin.area_vector(t).dot(&forward)).sum::<f64>() < 0.0
        };
        if inside_out {
            skin.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        Ok(PoseSurfaces { skin, chest_wall: TriMesh::default() })
    }
}

/// Cells of a breast's base, along each of its half axes, of which each is to have skin in front of it.
const CELLS: usize = 8;
/// Elliptic radius up to which they count.
const INNER_RADIUS: f64 = 0.9;
/// Part of the cells that must have skin.
const LEAST_COVERED: f64 = 0.9;

/// Refuses a skin (mm, reference frame) that does not reach over both breasts, or has holes over them: the distance to the rim of
/// a hole would be taken for one to the skin.
///
/// # Errors
/// [`Failure::BadInput`] with the side and the part of it that is covered.
pub fn covers(pose: &str, skin: &TriMesh, anatomy: &Anatomy) -> Result<(), Failure> {
    for base in &anatomy.breasts {
        let cell = |p: &Vec3| -> Option<[usize; 2]> {
            let at = base.elliptic(p).map(|x| (0.5 * (x + 1.0) * CELLS as f64).floor());
            let inside = at.iter().all(|x| (0.0..CELLS as f64).contains(x));
            (inside && (p - base.center).dot(&base.normal) > 0.0).then(|| at.map(|x| x as usize))
        };
        let mut seen = [[false; CELLS]; CELLS];
        let middles = (0..skin.triangles.len()).map(|t| skin.corners(t).iter().sum::<Vec3>() / 3.0);
        for [i, j] in middles.filter_map(|p| cell(&p)).chain(skin.points.iter().filter_map(cell)) {
            seen[i][j] = true;
        }
        let middle = |n: usize| (2.0 * n as f64 + 1.0) / CELLS as f64 - 1.0;
        let (mut asked, mut found) = (0, 0);
        for (i, row) in seen.iter().enumerate() {
            for (j, seen) in row.iter().enumerate() {
                if middle(i).hypot(middle(j)) < INNER_RADIUS {
                    asked += 1;
                    found += usize::from(*seen);
                }
            }
        }
        let part = f64::from(found as u32) / f64::from(asked as u32);
        if part < LEAST_COVERED {
            return Err(Failure::BadInput(format!(
                "scans.{pose}: the scan covers {:.0} % of the {} breast; it must reach over both breasts without holes. \
                 If it does, look at its landmarks and units",
                100.0 * part,
                base.side.name()
            )));
        }
    }
    Ok(())
}

/// Vertices on edges of one triangle only.
pub fn border(surface: &TriMesh) -> Vec<u32> {
    let mut count: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for &[a, b, c] in &surface.triangles {
        for [a, b] in [[a, b], [b, c], [c, a]] {
            *count.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let mut border: Vec<u32> =
        count.into_iter().filter(|(_, count)| *count == 1).flat_map(|(edge, _)| edge).collect();
    border.sort_unstable();
    border.dedup();
    border
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::BreastBase;
    use mammotwin_data::{labels::Side, progress::Silent, rigid::RigidTransform};

    fn marks(places: &[(&str, [f64; 3])]) -> Landmarks {
        Landmarks(places.iter().map(|(n, p)| ((*n).to_owned(), Vec3::from(*p))).collect())
    }

    const CHEST: [(&str, [f64; 3]); 4] = [
        ("chest_a", [0.0, 60.0, 70.0]),
        ("chest_b", [0.0, 65.0, -50.0]),
        ("chest_c", [80.0, 30.0, -60.0]),
        ("nipple_left", [-70.0, 90.0, 0.0]),
    ];

    #[test]
    fn landmarks_place_a_scan_with_its_gravity() {
        let truth = RigidTransform {
            rotation: *nalgebra::Rotation3::from_euler_angles(0.2, -0.4, 0.9).matrix(),
            translation: Vec3::new(400.0, -30.0, 1100.0),
        };
        let back = truth.inverse();
        let seen = |scale: f64| {
            let own = marks(&CHEST).0.into_iter();
            Landmarks(own.map(|(name, p)| (name, scale * back.point(&p))).collect())
        };
        let gravity_in_scan = back.direction(&-Vec3::z());
        let place = PlaceScan { pose: "upright".into(), gravity_in_scan };
        let own = seen(1.0);
        let found = place.run(&(Some(marks(&CHEST)), own.clone()), &Silent).unwrap();
        assert!((found.gravity + Vec3::z()).norm() < 1e-9);
        let nipple = found.transform.point(&own.0["nipple_left"]);
        assert!((nipple - Vec3::new(-70.0, 90.0, 0.0)).norm() < 1e-9);
        // In centimetres the marks do not fit.
        let said = place.run(&(Some(marks(&CHEST)), seen(0.1)), &Silent).unwrap_err().to_string();
        assert!(said.contains("scans.upright") && said.contains("millimetres"), "{said}");
        for reference in [None, Some(marks(&CHEST[..2]))] {
            let said = place.run(&(reference, own.clone()), &Silent).unwrap_err().to_string();
            assert!(said.contains("fewer than three"), "{said}");
        }
    }

    #[test]
    fn a_scan_with_a_hole_or_of_one_breast_is_refused() {
        let base = |side: Side, x: f64| BreastBase {
            side,
            center: Vec3::new(x, 0.0, 0.0),
            lateral: Vec3::x() * x.signum(),
            cranial: Vec3::z(),
            normal: Vec3::y(),
            half_axes_mm: [50.0, 60.0],
            nipple: Vec3::new(x, 40.0, 0.0),
            projection_mm: 40.0,
        };
        let breasts = vec![base(Side::Right, 70.0), base(Side::Left, -70.0)];
        let anatomy = Anatomy { sternum_x_mm: 0.0, breasts };
        // A sheet of triangles of 5 mm in front of both, where `keep` says.
        let sheet = |keep: &dyn Fn(&Vec3) -> bool| {
            let (columns, rows) = (57, 29);
            let place = |n: u32| {
                let [i, j] = [n % columns, n / columns].map(f64::from);
                Vec3::new(5.0 * i - 140.0, 30.0, 5.0 * j - 70.0)
            };
            let points: Vec<Vec3> = (0..columns * rows).map(place).collect();
            let cells = (0..rows - 1).flat_map(|j| (0..columns - 1).map(move |i| j * columns + i));
            let triangles: Vec<[u32; 3]> = cells
                .flat_map(|n| [[n, n + 1, n + columns], [n + 1, n + columns + 1, n + columns]])
                .filter(|t| t.iter().all(|n| keep(&points[*n as usize])))
                .collect();
            TriMesh { points, triangles }.compacted().0
        };
        covers("upright", &sheet(&|_| true), &anatomy).unwrap();
        for (part, says) in [
            (sheet(&|p| p.x > 0.0), "of the left breast"),
            (sheet(&|p| (p - Vec3::new(70.0, 30.0, 0.0)).norm() > 25.0), "of the right breast"),
        ] {
            let said = covers("upright", &part, &anatomy).unwrap_err().to_string();
            assert!(said.contains(says) && said.contains("scans.upright"), "{said}");
        }
    }

    #[test]
    fn normals_of_open_and_closed_scans_point_outwards() {
        let still = Registered::reference(-Vec3::z());
        let square = TriMesh {
            points: [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
                .map(Vec3::from)
                .to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        assert!(square.area_vector(0).y < 0.0);
        assert_eq!(border(&square), [0, 1, 2, 3]);
        let run = |surface: &TriMesh| {
            SkinScan { unit: ScanUnit::Cm }
                .run(&(surface.clone(), still.clone()), &Silent)
                .unwrap()
                .skin
        };
        let found = run(&square);
        assert!((found.area_vector(0).y - 50.0).abs() < 1e-9);
        assert_eq!(run(&found).triangles, found.triangles);

        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let turned = TriMesh {
            points: corners.map(Vec3::from).to_vec(),
            triangles: vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]],
        };
        assert!(turned.volume_mm3() < 0.0 && border(&turned).is_empty());
        assert!(run(&turned).volume_mm3() > 0.0);
    }
}
