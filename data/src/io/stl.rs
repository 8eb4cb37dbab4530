//! Surfaces from STL files, binary or as text.
//!
//! STL has triangles only, and no units. Corners that agree to the last bit become one vertex; normals
//! are those of the order of the corners, whatever the file says.

use crate::{Failure, Vec3, surface::TriMesh};
use std::{
    fs::File,
    io::{BufReader, BufWriter},
    path::Path,
};

/// Larger files are no paddle (bytes).
const MOST_BYTES: u64 = 256 << 20;

/// Reads a surface, in the units of the file.
///
/// # Errors
/// [`Failure::Io`]; [`Failure::BadInput`] when the file is no STL file, is cut off, holds no triangle or a number that is not finite.
pub fn read(path: &Path) -> Result<TriMesh, Failure> {
    let content = |what: String| Failure::BadInput(format!("{}: {what}", path.display()));
    let file = super::open_up_to(path, MOST_BYTES, "export it with coarser facets")?;
    let mesh = stl_io::read_stl(&mut BufReader::new(file))
        .map_err(|cause| content(format!("no STL file, or cut off: {cause}; export it anew")))?;
    if mesh.faces.is_empty() {
        return Err(content("holds no triangle; export a solid".into()));
    }
    let points: Vec<Vec3> =
        mesh.vertices.iter().map(|v| Vec3::from([v[0], v[1], v[2]].map(f64::from))).collect();
    if !points.iter().flat_map(|p| p.iter()).all(|x| x.is_finite()) {
        return Err(content("holds a coordinate that is not finite; export it anew".into()));
    }
    let index = |face: &stl_io::IndexedTriangle| face.vertices.map(|n| n as u32);
    // Facets without an area are left by some programs where they merge corners.
    let has_area = |&[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    let triangles = mesh.faces.iter().map(index).filter(has_area).collect();
    Ok(TriMesh { points, triangles })
}

/// Writes a surface as a binary file, in single precision.
///
/// # Errors
/// [`Failure::Io`].
pub fn write(path: &Path, surface: &TriMesh) -> Result<(), Failure> {
    let io = |error: std::io::Error| Failure::io(path, error);
    let vertex = |p: Vec3| stl_io::Vertex::new([p.x as f32, p.y as f32, p.z as f32]);
    let facets: Vec<stl_io::Triangle> = (0..surface.triangles.len())
        .map(|t| {
            let normal = surface.area_vector(t).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            stl_io::Triangle { normal: vertex(normal), vertices: surface.corners(t).map(vertex) }
        })
        .collect();
    let mut file = BufWriter::new(File::create(path).map_err(io)?);
    stl_io::write_stl(&mut file, facets.iter()).map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> TriMesh {
        let points = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 30.5]];
        TriMesh {
            points: points.map(Vec3::from).to_vec(),
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        }
    }

    #[test]
    fn surfaces_come_back_from_binary_files_and_from_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.stl");
        write(&path, &tetrahedron()).unwrap();
        let found = read(&path).unwrap();
        assert_eq!((found.points.len(), found.triangles.len()), (4, 4));
        assert!((found.volume_mm3() - 10.0 * 20.0 * 30.5 / 6.0).abs() < 1e-3);

        let mut text = String::from("solid one\n");
        for t in 0..4 {
            text += "facet normal 0 0 0\nouter loop\n";
            for p in tetrahedron().corners(t) {
                text += &format!("vertex {} {} {}\n", p.x, p.y, p.z);
            }
            text += "endloop\nendfacet\n";
        }
        std::fs::write(&path, text + "endsolid one\n").unwrap();
        let again = read(&path).unwrap();
        assert!((again.volume_mm3() - found.volume_mm3()).abs() < 1e-3);
    }

    #[test]
    fn files_that_are_none_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.stl");
        assert!(matches!(read(&path), Err(Failure::Io { .. })), "missing");
        for bytes in [&b""[..], b"PK\x03\x04 a zip", b"solid a\nendsolid a\n", &[0; 84]] {
            std::fs::write(&path, bytes).unwrap();
            let error = read(&path).expect_err("no surface");
            assert!(matches!(error, Failure::BadInput(_)), "{error}");
        }
        write(&path, &tetrahedron()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("cut off"));
        let mut bad = tetrahedron();
        bad.points[1].x = f64::NAN;
        write(&path, &bad).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("not finite"));
    }
}
