//! The one unit system inside the code, and the constants that cross its border.
//!
//! | quantity   | unit   | remark                            |
//! |------------|--------|-----------------------------------|
//! | length     | mm     |                                   |
//! | stress     | kPa    | soft-tissue moduli are 0.1 - 200  |
//! | force      | mN     | = kPa mm²                         |
//! | energy     | µJ     | = kPa mm³                         |
//! | body force | kPa/mm | = mN/mm³                          |
//! | angle      | rad    |                                   |
//! | photon     | keV    |                                   |
//! | dose       | mGy    |                                   |
//!
//! At the borders (study files, HDF5, reports, the command line) a name carries its unit:
//! `force_n`, `young_kpa`. Cross it with the constants: `22.0 * NEWTON` in, `force / NEWTON` out.

/// One newton in internal force units (mN).
pub const NEWTON: f64 = 1000.0;
/// Weight of 1 g/cm³ under standard gravity in kPa/mm: one metre of it presses 9.80665 kPa.
pub const WEIGHT_OF_G_PER_CM3: f64 = 9.80665e-3;
/// One degree in radians.
pub const DEGREE: f64 = std::f64::consts::PI / 180.0;
