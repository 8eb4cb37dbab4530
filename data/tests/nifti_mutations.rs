//! Two thousand damaged files, of both byte orders: each is read or refused, without panic, at once and without much memory.

#![allow(clippy::unwrap_used)] // a test may fail at once

use mammotwin_data::{
    Mat3, Vec3,
    io::nifti::{self, NiftiError, Version, VoxelType},
    volume::{Grid, Volume},
};
use std::{
    io::Write,
    path::Path,
    time::{Duration, Instant},
};

/// Splitmix64 (Steele 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % count as u64) as usize
    }
}

fn sound(folder: &Path) -> Vec<Vec<u8>> {
    let axes = Mat3::new(0.0, -1.2, 0.0, 0.8, 0.0, 0.3, 0.0, 0.0, 2.0);
    let grid = Grid { shape: [6, 5, 4], axes, origin: Vec3::new(1.0, -2.0, 3.0) };
    let values = (0..grid.len()).map(|n| (n % 7) as f32).collect();
    let image = Volume { grid, values };
    let path = folder.join("sound.nii");
    let mut files = Vec::new();
    for version in [Version::One, Version::Two] {
        for voxel in [VoxelType::I16, VoxelType::F32] {
            nifti::write(&path, &image, voxel, version).unwrap();
            files.push(std::fs::read(&path).unwrap());
        }
    }
    let other = big_endian(files[0].clone());
    let of = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        nifti::read(&path).unwrap()
    };
    assert_eq!(of(&other), of(&files[0]), "the other byte order");
    files.push(other);
    files
}

/// The same NIfTI-1 file of 16-bit voxels in the other byte order (field sizes of `nifti1.h`).
fn big_endian(mut bytes: Vec<u8>) -> Vec<u8> {
    const WORDS: [std::ops::Range<usize>; 6] = [0..4, 32..36, 56..68, 76..120, 124..148, 256..328];
    const HALVES: [std::ops::Range<usize>; 5] = [36..38, 40..56, 68..76, 120..122, 252..256];
    for (ranges, size) in [(&WORDS[..], 4), (&HALVES[..], 2)] {
        for range in ranges {
            bytes[range.clone()].chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
    }
    bytes[352..].chunks_exact_mut(2).for_each(<[u8]>::reverse);
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// One to four changes: of header bytes most often, also cuts, growth and repetition.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    const TELLING: [u8; 8] = [0, 1, 0x7f, 0x80, 0xff, 0xc0, 0xf0, 2];
    for _ in 0..=random.below(4) {
        let header = bytes.len().min(544);
        match random.below(12) {
            0 => bytes.truncate(random.below(bytes.len() + 1)),
            1 => bytes.extend(std::iter::repeat_n(TELLING[random.below(8)], random.below(9000))),
            2 => {
                let (from, to) = (random.below(bytes.len()), random.below(bytes.len()));
                let part = bytes[from.min(to)..from.max(to)].to_vec();
                let at = random.below(bytes.len());
                bytes.splice(at..at, part);
            }
            3..6 => {
                let at = random.below(header);
                let end = (at + 1 + random.below(8)).min(header);
                bytes[at..end].fill(TELLING[random.below(8)]);
            }
            6..10 => {
                let at = random.below(header);
                bytes[at] = TELLING[random.below(8)];
            }
            _ => {
                let at = random.below(bytes.len());
                bytes[at] ^= 1 << random.below(8);
            }
        }
        if bytes.is_empty() {
            return;
        }
    }
}

/// Largest address space so far (kB), where the system tells.
fn peak_kb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmPeak"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// What is read is sound: every number of it and of its description means something, and written again it is the same.
fn is_sound(path: &Path, image: &Volume<f32>) {
    assert_eq!(image.values.len(), image.grid.len());
    assert!(image.values.iter().all(|v| v.is_finite()));
    let summary = nifti::inspect(path).unwrap();
    let numbers = summary.spacing_mm.iter().chain(summary.affine.iter().flatten());
    assert!(numbers.chain([&summary.obliquity_deg]).all(|x| x.is_finite()), "{summary:?}");
    assert!(summary.spacing_mm.iter().all(|mm| *mm > 0.0) && !summary.orientation.contains('?'));
    let inverse = image.grid.axes.try_inverse().unwrap();
    assert!(inverse.iter().all(|x| x.is_finite()) && image.grid.voxel_mm3() > 0.0, "{summary:?}");
    let again = path.with_file_name("again.nii");
    nifti::write(&again, image, VoxelType::F32, Version::Two).unwrap();
    assert_eq!(&nifti::read(&again).unwrap(), image, "{summary:?}");
}

#[test]
fn damaged_files_are_read_or_refused_in_one_line() {
    damaged(7, 2000);
}

#[test]
#[ignore = "minutes of writing: forty thousand more"]
fn forty_thousand_more_are_read_or_refused() {
    (100..120).for_each(|seed| damaged(seed, 2000));
}

fn damaged(seed: u64, count: usize) {
    let folder = tempfile::tempdir().unwrap();
    let files = sound(folder.path());
    let path = folder.path().join("damaged.nii");
    let before = peak_kb();
    let mut random = Random(seed);
    let (mut read, mut refused, mut slowest) = (0, 0, Duration::ZERO);
    for n in 0..count {
        let mut bytes = files[n % files.len()].clone();
        // A third plain, a third damaged and then compressed, a third compressed and then damaged.
        if n % 3 == 2 {
            bytes = gzip(&bytes);
        }
        damage(&mut bytes, &mut random);
        if n % 3 == 1 {
            bytes = gzip(&bytes);
        }
        std::fs::write(&path, &bytes).unwrap();
        let clock = Instant::now();
        assert_eq!(nifti::inspect(&path).is_ok(), nifti::read(&path).is_ok());
        let _ = nifti::read_labels(&path);
        slowest = slowest.max(clock.elapsed());
        match nifti::read(&path) {
            Ok(image) => {
                read += 1;
                is_sound(&path, &image);
            }
            Err(NiftiError::Content { field, what, .. }) => {
                refused += 1;
                assert!(!field.is_empty() && what.len() < 200 && !what.contains('\n'), "{what}");
            }
            Err(error) => panic!("{error}"),
        }
    }
    println!("{read} read, {refused} refused, the slowest in {slowest:?}");
    assert!(slowest < Duration::from_secs(5), "{slowest:?}");
    assert!(read > 100 && refused > 1000);
    if let (Some(before), Some(after)) = (before, peak_kb()) {
        println!("{} kB more", after - before);
        assert!(after - before < 64 << 10, "{} kB", after - before);
    }
}
