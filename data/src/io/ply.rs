//! Surfaces from PLY files, as text or binary of either byte order.

use crate::{Failure, Vec3, surface::TriMesh};
use ply_rs_bw::{
    parser::Parser,
    ply::{DefaultElement, Ply, Property},
};
use std::{io::BufReader, path::Path};

/// Larger files are no scan of a person (bytes).
const MOST_BYTES: u64 = 1 << 30;
/// Names that programs give the corners of a face.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Reads a surface, in the units of the file. Faces of more than three corners become triangles about their first one.
///
/// # Errors
/// [`Failure::Io`]; [`Failure::BadInput`] when the file is no PLY file, is cut off, holds no face, a face with a corner
/// that is not there, or a coordinate that is not finite.
pub fn read(path: &Path) -> Result<TriMesh, Failure> {
    let content = |what: String| Failure::BadInput(format!("{}: {what}", path.display()));
    let file = super::open_up_to(path, MOST_BYTES, "export it with coarser facets")?;
    let file: Ply<DefaultElement> = Parser::new()
        .read_ply(&mut BufReader::new(file))
        .map_err(|cause| content(format!("no PLY file, or cut off: {cause}; export it anew")))?;
    let elements = |name: &str| file.payload.get(name).map_or(&[][..], Vec::as_slice);
    let points: Option<Vec<Vec3>> = elements("vertex").iter().map(point).collect();
    let points = points.ok_or_else(|| content("a vertex has no x, y and z".into()))?;
    if !points.iter().flat_map(|p| p.iter()).all(|x| x.is_finite()) {
        return Err(content("holds a coordinate that is not finite; export it anew".into()));
    }
    let mut triangles = Vec::new();
    for face in elements("face") {
        let corners =
            corners(face).ok_or_else(|| content("a face has no list of vertices".into()))?;
        if let Some(n) = corners.iter().find(|n| **n as usize >= points.len()) {
            let what = format!("a face has vertex {n}, and there are {}", points.len());
            return Err(content(what));
        }
        let fan = corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]);
        triangles.extend(fan.filter(|&[a, b, c]| a != b && b != c && c != a));
    }
    if triangles.is_empty() {
        return Err(content("holds no face; export a surface, not points alone".into()));
    }
    Ok(TriMesh { points, triangles })
}

fn point(vertex: &DefaultElement) -> Option<Vec3> {
    let along = |name: &str| match *vertex.get(name)? {
        Property::Float(x) => Some(f64::from(x)),
        Property::Double(x) => Some(x),
        Property::Int(x) => Some(f64::from(x)),
        Property::Short(x) => Some(f64::from(x)),
        _ => None,
    };
    Some(Vec3::new(along("x")?, along("y")?, along("z")?))
}

/// Vertices of a face; `None` when it has none, or one below zero.
fn corners(face: &DefaultElement) -> Option<Vec<u32>> {
    let list = CORNERS.iter().find_map(|name| face.get(*name))?;
    match list {
        Property::ListUInt(list) => Some(list.clone()),
        Property::ListInt(list) => list.iter().map(|n| u32::try_from(*n).ok()).collect(),
        Property::ListUShort(list) => Some(list.iter().map(|n| u32::from(*n)).collect()),
        Property::ListShort(list) => list.iter().map(|n| u32::try_from(*n).ok()).collect(),
        Property::ListUChar(list) => Some(list.iter().map(|n| u32::from(*n)).collect()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const HEAD: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                        property uchar red\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n";
    const BODY: &str = "0 0 0 9\n10 0 0 9\n10 10 0 9\n0 10 0 9\n5 5 8 9\n4 0 1 2 3\n3 0 1 4\n";

    #[test]
    fn faces_of_four_corners_become_triangles_in_all_formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        fs::write(&path, format!("{HEAD}{BODY}")).unwrap();
        let found = read(&path).unwrap();
        assert_eq!(found.points[4], Vec3::new(5.0, 5.0, 8.0));
        assert_eq!(found.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);

        let mut binary = HEAD.replace("ascii", "binary_little_endian").into_bytes();
        for p in &found.points {
            binary.extend(p.iter().flat_map(|x| (*x as f32).to_le_bytes()));
            binary.push(9);
        }
        for face in [&[0, 1, 2, 3][..], &[0, 1, 4]] {
            binary.push(face.len() as u8);
            binary.extend(face.iter().flat_map(|n: &i32| n.to_le_bytes()));
        }
        fs::write(&path, &binary).unwrap();
        assert_eq!(read(&path).unwrap(), found);
        fs::write(&path, &binary[..binary.len() - 5]).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("cut off"));
    }

    #[test]
    fn files_that_are_none_are_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        assert!(matches!(read(&path), Err(Failure::Io { .. })), "missing");
        let points = HEAD.replace("element face 2", "element face 0");
        for (text, says) in [
            ("PK\u{3}\u{4} a zip".into(), "no PLY file"),
            (format!("{HEAD}{}", BODY.replace("3 0 1 4", "3 0 1 7")), "vertex 7"),
            (format!("{HEAD}{}", BODY.replace("3 0 1 4", "3 0 1 -1")), "no list of vertices"),
            (format!("{HEAD}{}", BODY.replace("5 5 8 9", "5 5 nan 9")), "no PLY file"),
            (format!("{points}{}", &BODY[..BODY.len() - 18]), "no face"),
            (format!("{}{BODY}", HEAD.replace("float z", "float w")), "no x, y and z"),
        ] {
            fs::write(&path, text).unwrap();
            let error = read(&path).unwrap_err();
            assert!(
                matches!(error, Failure::BadInput(_)) && error.to_string().contains(says),
                "{error}"
            );
        }
    }
}
