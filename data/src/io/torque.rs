//! Torque of a flex paddle's hinge from a measured table of force and angle.
//!
//! ```text
//! # paddle 18 x 24, load cell at its front
//! angle_deg,force_n,lever_mm
//! 0.5,3.1,110
//! ```
//!
//! One row a reading; repeats are rows of their own. The torque is the force times its lever, the distance of
//! its line from the axis of the hinge.

use crate::Failure;
use std::{fs, path::Path};

/// First line of the table.
pub const HEADER: &str = "angle_deg,force_n,lever_mm";
/// Larger files are no tables (bytes).
const MOST_BYTES: u64 = 1 << 20;
/// Fewest different angles that two coefficients and their misfit are found from.
const FEWEST_ANGLES: usize = 3;

/// A measured hinge.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueTable {
    /// Angle (rad) and torque (N mm) of each reading.
    pub readings: Vec<[f64; 2]>,
}

/// Torque = linear · θ + quadratic · θ².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorqueLaw {
    /// N mm/rad.
    pub linear_n_mm_per_rad: f64,
    /// N mm/rad².
    pub quadratic_n_mm_per_rad2: f64,
    /// Share of the torques' variance that the law explains (R²).
    pub r_squared: f64,
    /// Number of readings.
    pub readings: usize,
    /// Largest measured angle (degrees); the law is a guess beyond it.
    pub largest_deg: f64,
}

/// Reads a table.
///
/// # Errors
/// [`Failure::BadInput`] with the line that cannot be meant.
pub fn read(path: &Path) -> Result<TorqueTable, Failure> {
    let refuse = |why: String| Failure::BadInput(format!("{}: {why}", path.display()));
    let size = fs::metadata(path).map_err(|cause| Failure::io(path, cause))?.len();
    if size > MOST_BYTES {
        return Err(refuse(format!("{size} bytes; give a short table {HEADER}")));
    }
    let bytes = fs::read(path).map_err(|cause| Failure::io(path, cause))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| refuse("is no UTF-8 text; save it as UTF-8".into()))?;
    parse(&text).map_err(refuse)
}

fn parse(text: &str) -> Result<TorqueTable, String> {
    let text = text.trim_start_matches('\u{feff}');
    let lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim()));
    let mut rows = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let header: String = rows.next().map_or("", |(_, line)| line).split_whitespace().collect();
    if header != HEADER {
        return Err(format!("the first line must be {HEADER}"));
    }
    let mut readings = Vec::new();
    for (n, line) in rows {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let [angle, force, lever] = cells[..] else {
            return Err(format!("line {n}: has {} cells, not 3", cells.len()));
        };
        let number = |name: &str, cell: &str, [least, most]: [f64; 2]| {
            let value = cell.parse::<f64>().ok().filter(|v| (least..=most).contains(v));
            value.ok_or_else(|| format!("line {n}: {name}: write a number from {least} to {most}"))
        };
        let angle_rad = number("angle_deg", angle, [0.0, 45.0])?.to_radians();
        let force_n = number("force_n", force, [0.0, 2000.0])?;
        let lever_mm = number("lever_mm", lever, [1.0, 1000.0])?;
        readings.push([angle_rad, force_n * lever_mm]);
    }
    let mut angles: Vec<f64> = readings.iter().map(|[angle, _]| *angle).collect();
    angles.retain(|angle| *angle > 0.0);
    angles.sort_by(f64::total_cmp);
    angles.dedup();
    if angles.len() < FEWEST_ANGLES {
        let count = angles.len();
        return Err(format!("{count} angles above 0; give {FEWEST_ANGLES} or more"));
    }
    Ok(TorqueTable { readings })
}

impl TorqueTable {
    /// The quadratic law through the origin that is nearest to the readings by least squares.
    ///
    /// # Errors
    /// A law that falls or bends downwards: no hinge that gives way ever less.
    pub fn law(&self) -> Result<TorqueLaw, String> {
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            self.readings.iter().map(|[angle, torque]| of(*angle, *torque)).sum()
        };
        let power = |n: i32| sum(&|angle, _| angle.powi(n));
        let [second, third, fourth] = [2, 3, 4].map(power);
        let [first_moment, second_moment] =
            [sum(&|angle, torque| angle * torque), sum(&|angle, torque| angle * angle * torque)];
        let determinant = second * fourth - third * third;
        let linear = (first_moment * fourth - second_moment * third) / determinant;
        let quadratic = (second * second_moment - third * first_moment) / determinant;
        let count = self.readings.len() as f64;
        let mean = sum(&|_, torque| torque) / count;
        let left = sum(&|angle, torque| (torque - angle * (linear + quadratic * angle)).powi(2));
        let whole = sum(&|_, torque| (torque - mean).powi(2));
        if !(linear > 0.0 && quadratic >= 0.0) {
            return Err(format!(
                "the nearest law is {linear:.0} θ + {quadratic:.0} θ² N mm; a hinge has a positive first and no \
                 negative second coefficient: look for the wrong zero of the angle or the wrong lever"
            ));
        }
        let largest = self.readings.iter().map(|[angle, _]| *angle).fold(0.0, f64::max);
        Ok(TorqueLaw {
            linear_n_mm_per_rad: linear,
            quadratic_n_mm_per_rad2: quadratic,
            r_squared: if whole > 0.0 { 1.0 - left / whole } else { 0.0 },
            readings: self.readings.len(),
            largest_deg: largest.to_degrees(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(noise: &dyn Fn(usize) -> f64) -> TorqueTable {
        let mut text = format!("# measured\n{HEADER}\n");
        for n in 0..=20 {
            let angle = 0.5 * n as f64;
            let rad = angle.to_radians();
            let torque = 20_000.0 * rad + 150_000.0 * rad * rad + noise(n);
            // The load cell moves: two levers.
            let lever = if n % 2 == 0 { 120.0 } else { 90.0 };
            text += &format!("{angle},{},{lever}\n", (torque / lever).max(0.0));
        }
        parse(&text).unwrap()
    }

    #[test]
    fn a_law_is_found_again_and_noise_lowers_its_r_squared_as_it_must() {
        let exact = table(&|_| 0.0).law().unwrap();
        assert!((exact.linear_n_mm_per_rad / 20_000.0 - 1.0).abs() < 1e-9, "{exact:?}");
        assert!((exact.quadratic_n_mm_per_rad2 / 150_000.0 - 1.0).abs() < 1e-9);
        assert!((exact.r_squared - 1.0).abs() < 1e-12 && exact.readings == 21);
        assert!((exact.largest_deg - 10.0).abs() < 1e-9);
        // An error of ±300 N mm that changes its sign from reading to reading.
        let rough = table(&|n| if n == 0 { 0.0 } else { 300.0 * (-1f64).powi(n as i32) });
        let law = rough.law().unwrap();
        let mean = rough.readings.iter().map(|r| r[1]).sum::<f64>() / 21.0;
        let whole = rough.readings.iter().map(|r| (r[1] - mean).powi(2)).sum::<f64>();
        let foretold = 1.0 - 20.0 * 300.0 * 300.0 / whole;
        println!("{:.5}, with the true law {foretold:.5}", law.r_squared);
        // The fit takes two of twenty degrees of freedom.
        assert!(law.r_squared >= foretold && law.r_squared < 1.0 - 0.7 * (1.0 - foretold));
        assert!((law.linear_n_mm_per_rad / 20_000.0 - 1.0).abs() < 0.1);
    }

    #[test]
    fn what_cannot_be_meant_is_refused_with_its_line() {
        for (text, says) in [
            ("angle,force\n1,2\n", "the first line must be angle_deg,force_n,lever_mm"),
            ("angle_deg,force_n,lever_mm\n1,2\n", "line 2: has 2 cells, not 3"),
            ("# a\n\nangle_deg,force_n,lever_mm\n1,x,100\n", "line 4: force_n"),
            ("angle_deg,force_n,lever_mm\n1,3,100\n-2,5,100\n", "line 3: angle_deg"),
            ("angle_deg,force_n,lever_mm\n1,3,0\n", "line 2: lever_mm"),
            ("angle_deg,force_n,lever_mm\n1,nan,9\n", "line 2: force_n"),
            ("angle_deg,force_n,lever_mm\n0,0,9\n1,3,9\n1,4,9\n2,8,9\n", "2 angles above 0"),
        ] {
            let why = parse(text).unwrap_err();
            assert!(why.contains(says), "{why}");
        }
        let softening = "angle_deg,force_n,lever_mm\n1,10,100\n2,14,100\n3,17,100\n4,19,100\n";
        assert!(parse(softening).unwrap().law().unwrap_err().contains("negative second"));
    }
}
