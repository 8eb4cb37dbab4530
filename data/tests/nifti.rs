//! NIfTI files in and out: what is kept, what is refused, and in which words.

#![allow(clippy::unwrap_used)] // a test may fail at once

use mammotwin_data::{
    Failure, Mat3, Vec3,
    io::nifti::{self, NiftiError, Version, VoxelType},
    labels::Tissue,
    volume::{Grid, Volume},
};
use std::path::{Path, PathBuf};

/// An oblique, left-handed image without symmetry.
fn image() -> Volume<f32> {
    let turn = *nalgebra::Rotation3::new(Vec3::new(0.1, -0.3, 0.8)).matrix();
    let axes = turn * Mat3::from_diagonal(&Vec3::new(-1.25, 0.75, 2.5));
    let grid = Grid { shape: [7, 6, 5], axes, origin: Vec3::new(-30.5, 12.25, 5.0) };
    let values = (0..grid.len()).map(|n| (n * n % 257) as f32 - 40.0).collect();
    Volume { grid, values }
}

fn single_precision(grid: &Grid) -> Grid {
    Grid {
        shape: grid.shape,
        axes: grid.axes.map(|v| f64::from(v as f32)),
        origin: grid.origin.map(|v| f64::from(v as f32)),
    }
}

/// Bytes of [`image`] as 16-bit NIfTI-1.
fn plain_bytes(folder: &Path) -> Vec<u8> {
    let path = folder.join("plain.nii");
    nifti::write(&path, &image(), VoxelType::I16, Version::One).unwrap();
    std::fs::read(path).unwrap()
}

fn keep(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

#[test]
fn an_image_survives_the_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let image = image();
    for voxel in [VoxelType::I16, VoxelType::F32] {
        for (version, name) in
            [(Version::One, "a.nii"), (Version::One, "a.nii.gz"), (Version::Two, "b.nii.gz")]
        {
            let path = folder.path().join(name);
            nifti::write(&path, &image, voxel, version).unwrap();
            let back = nifti::read(&path).unwrap();
            assert_eq!(back.values, image.values);
            let exact = version == Version::Two;
            let grid = if exact { image.grid.clone() } else { single_precision(&image.grid) };
            assert_eq!(back.grid, grid);
            let first = std::fs::read(&path).unwrap();
            nifti::write(&path, &image, voxel, version).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), first, "the same image, other bytes");
        }
    }
}

#[test]
fn qform_alone_states_the_same_grid() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = plain_bytes(folder.path());
    bytes[254..256].copy_from_slice(&[0, 0]);
    let back = nifti::read(&keep(folder.path(), "q.nii", &bytes)).unwrap();
    assert!((back.grid.axes - image().grid.axes).norm() < 1e-6);
    assert!((back.grid.origin - image().grid.origin).norm() < 1e-5);
}

#[test]
fn scaled_integers_are_within_half_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scaled.nii");
    let image = Volume { values: image().values.iter().map(|v| v * 0.37).collect(), ..image() };
    let span = 256.0 * 0.37;
    for (voxel, steps) in [(VoxelType::U8, 255.0), (VoxelType::I16, 65535.0)] {
        nifti::write(&path, &image, voxel, Version::One).unwrap();
        let back = nifti::read(&path).unwrap();
        let worst = back.values.iter().zip(&image.values).map(|(a, b)| (a - b).abs());
        assert!(worst.fold(0.0, f32::max) < 0.51 * span / steps + 1e-5);
    }
}

#[test]
fn labels_survive_and_unknown_ones_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.nii.gz");
    let labels = image().map(|v| Tissue::ALL[(v + 40.0) as usize % 10]);
    nifti::write_labels(&path, &labels, Version::Two).unwrap();
    assert_eq!(nifti::read_labels(&path).unwrap(), labels);
    let wrong = labels.map(|t| if t == Tissue::Other { 10.0 } else { f32::from(t.label()) });
    nifti::write(&path, &wrong, VoxelType::U8, Version::One).unwrap();
    let refusal = nifti::read_labels(&path).unwrap_err().to_string();
    assert!(refusal.contains("hold 10 at voxel"), "{refusal}");
}

#[test]
fn every_voxel_type_is_read_in_both_byte_orders() {
    let folder = tempfile::tempdir().unwrap();
    let plain = plain_bytes(folder.path());
    let values: Vec<i32> = image().values.iter().map(|&v| v as i32 + 40).collect();
    let check = |code: i16, bits: i16, little: &dyn Fn(i32) -> Vec<u8>| {
        let mut bytes = plain[..352].to_vec();
        bytes[70..72].copy_from_slice(&code.to_le_bytes());
        bytes[72..74].copy_from_slice(&bits.to_le_bytes());
        values.iter().for_each(|&v| bytes.extend(little(v / 3)));
        let back = nifti::read(&keep(folder.path(), "t.nii", &bytes)).unwrap();
        let expected: Vec<f32> = values.iter().map(|v| (v / 3) as f32).collect();
        assert_eq!(back.values, expected, "datatype {code}");
        for (from, to, size) in
            [(0, 4, 4), (40, 56, 2), (70, 74, 2), (76, 120, 4), (252, 256, 2), (256, 328, 4)]
        {
            bytes[from..to].chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        bytes[352..].chunks_exact_mut(usize::from(bits as u16) / 8).for_each(<[u8]>::reverse);
        let big = nifti::read(&keep(folder.path(), "t.nii", &bytes)).unwrap();
        assert_eq!(big, back, "big-endian datatype {code}");
    };
    check(2, 8, &|v| vec![v as u8]);
    check(256, 8, &|v| vec![v as u8]);
    check(4, 16, &|v| (v as i16).to_le_bytes().into());
    check(512, 16, &|v| (v as u16).to_le_bytes().into());
    check(8, 32, &|v| v.to_le_bytes().into());
    check(768, 32, &|v| (v as u32).to_le_bytes().into());
    check(1024, 64, &|v| i64::from(v).to_le_bytes().into());
    check(1280, 64, &|v| (v as u64).to_le_bytes().into());
    check(16, 32, &|v| (v as f32).to_le_bytes().into());
    check(64, 64, &|v| f64::from(v).to_le_bytes().into());
}

/// Each damaged header, the field that its refusal must name.
#[test]
fn a_damaged_header_is_refused_by_its_field() {
    let folder = tempfile::tempdir().unwrap();
    let plain = plain_bytes(folder.path());
    let check = |field: &str, changes: &[(usize, &[u8])]| {
        let mut bytes = plain.clone();
        for (at, new) in changes {
            bytes[*at..at + new.len()].copy_from_slice(new);
        }
        for (name, bytes) in [("d.nii", bytes.clone()), ("d.nii.gz", gzip(&bytes))] {
            match nifti::read(&keep(folder.path(), name, &bytes)) {
                Err(error @ NiftiError::Content { field: named, .. }) => {
                    assert_eq!(named, field, "{error}");
                    assert!(!error.to_string().contains('\n'));
                    assert_eq!(Failure::from(error).exit_code(), 65);
                }
                other => panic!("{field} {changes:?}: {other:?}"),
            }
        }
    };
    let nan = f32::NAN.to_le_bytes();
    check("sizeof_hdr", &[(0, &[0x5d, 1])]);
    check("magic", &[(344, b"xxxx")]);
    check("magic", &[(344, b"ni1\0"), (108, &[0; 4])]);
    check("dim", &[(40, &[0, 0])]);
    check("dim", &[(40, &[8, 0])]);
    check("dim", &[(42, &(-7i16).to_le_bytes())]);
    check("dim", &[(44, &[0, 0])]);
    check("dim", &[(40, &[4, 0]), (48, &[2, 0])]);
    check("dim", &[(42, &[0xff, 0x7f, 0xff, 0x7f, 0xff, 0x7f])]);
    check("dim", &[(44, &[0xff, 0x7f])]);
    check("dim", &[(42, &[8, 0, 0xff, 0x7f, 0xff, 0x7f])]);
    check("datatype", &[(70, &[0x0f, 0x27])]);
    check("datatype", &[(70, &[128, 0]), (72, &[24, 0])]);
    check("datatype", &[(70, &[32, 0]), (72, &[64, 0])]);
    check("bitpix", &[(72, &[8, 0])]);
    check("vox_offset", &[(108, &nan)]);
    check("vox_offset", &[(108, &0f32.to_le_bytes())]);
    check("vox_offset", &[(108, &352.5f32.to_le_bytes())]);
    check("vox_offset", &[(108, &1e30f32.to_le_bytes())]);
    check("scl_inter", &[(116, &nan)]);
    check("xyzt_units", &[(123, &[5])]);
    check("sform_code, qform_code", &[(252, &[0; 4])]);
    check("srow_x, srow_y, srow_z", &[(280, &nan)]);
    check("srow_x, srow_y, srow_z", &[(280, &[0; 48])]);
    check("quatern_b, quatern_c, quatern_d, qoffset", &[(254, &[0; 2]), (256, &nan)]);
    check("pixdim", &[(254, &[0; 2]), (80, &nan)]);
    check("pixdim", &[(254, &[0; 2]), (84, &0f32.to_le_bytes())]);
}

#[test]
fn damaged_bytes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let plain = plain_bytes(folder.path());
    let refused = |bytes: &[u8], words: &str| {
        let text = nifti::read(&keep(folder.path(), "f.nii.gz", bytes)).unwrap_err().to_string();
        assert!(text.contains(words), "{text}");
    };
    refused(&[], "empty");
    refused(&plain[..100], "cut short in the header");
    refused(&plain[..plain.len() - 1], "file can hold only");
    let packed = gzip(&plain);
    refused(&packed[..packed.len() / 2], "cut short in the voxels");
    refused(&packed[..packed.len() - 3], "cut short in the end of the file");
    let mut wrong = packed.clone();
    let crc = wrong.len() - 8;
    wrong[crc] ^= 1;
    refused(&wrong, "damaged in the end of the file");
    refused(&[&packed[..], &[7; 30]].concat(), "in the end of the file");
    refused(&[&plain[..], &[0; 5000]].concat(), "the file goes on");
    refused(&gzip(&[&plain[..], &[0; 5000]].concat()), "the file goes on");
    let mut nan = plain.clone();
    nan[70..74].copy_from_slice(&[16, 0, 32, 0]);
    nan.resize(352 + 840, 0);
    nan[352..].fill(0);
    nan[400..404].copy_from_slice(&f32::NAN.to_le_bytes());
    refused(&nan, "hold NaN at voxel [5, 1, 0]");
    assert!(matches!(nifti::read(folder.path()), Err(NiftiError::Content { field: "file", .. })));
    let missing = nifti::read(&folder.path().join("missing.nii")).unwrap_err();
    assert_eq!(Failure::from(missing).exit_code(), 74);
}

#[test]
fn a_decompression_bomb_is_refused() {
    use std::io::Write;
    let folder = tempfile::tempdir().unwrap();
    let mut head = plain_bytes(folder.path())[..352].to_vec();
    let path = folder.path().join("bomb.nii.gz");
    let bomb = |head: &[u8], megabytes: usize| {
        let file = std::fs::File::create(&path).unwrap();
        let mut out = flate2::write::GzEncoder::new(file, flate2::Compression::best());
        out.write_all(head).unwrap();
        (0..megabytes).for_each(|_| out.write_all(&[0; 1 << 20]).unwrap());
        out.finish().unwrap();
        nifti::read(&path).unwrap_err().to_string()
    };
    // A small image that goes on for 200 MB; an honest header of 200 MB of nothing.
    assert!(bomb(&head, 200).contains("the file goes on"));
    head[42..48].copy_from_slice(&[0, 2, 0, 2, 0x90, 1]);
    let text = bomb(&head, 200);
    assert!(text.contains("compressed bytes would become"), "{text}");
}

#[test]
fn a_summary_tells_what_a_person_must_know() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = plain_bytes(folder.path());
    let summary = nifti::inspect(&keep(folder.path(), "s.nii", &bytes)).unwrap();
    assert_eq!(summary.dims, [7, 6, 5]);
    assert_eq!((summary.dtype.as_str(), summary.format.as_str()), ("int16", "nifti-1"));
    assert_eq!(summary.warnings, Vec::<String>::new());
    assert!((summary.spacing_mm[2] - 2.5).abs() < 1e-6);
    bytes[123] = 0;
    bytes[112..116].copy_from_slice(&f32::NAN.to_le_bytes());
    bytes[84..88].copy_from_slice(&9f32.to_le_bytes());
    bytes.push(0);
    let summary = nifti::inspect(&keep(folder.path(), "s.nii", &bytes)).unwrap();
    let text = summary.warnings.join("; ");
    for word in ["xyzt_units", "scl_slope", "pixdim", "qform and sform", "1 bytes after"] {
        assert!(text.contains(word), "{word} is missing in {text}");
    }
}
