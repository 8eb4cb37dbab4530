//! A compression knows no unit of stiffness: tissues that are all stiffer in one proportion press in that proportion.

use mammotwin_data::study::CompressPlan;
use mammotwin_stages::force_curve::trial::{Meshed, Person};

/// Verifies: all tissues 11 times as stiff, from soft and from ten times stiffer breasts | forces at every state, 11 times | 0.1 %
#[test]
fn forces_are_in_proportion_to_stiffness() {
    for stiffer in [1.0, 10.0] {
        let person = Person { preset: "tiny".into(), seed: 7, stiffer };
        let ready = person.meshed(Meshed::new(15.0, 0)).unwrap();
        let [soft, stiff] = [0.0, 10.0].map(|rate_stiffening| {
            let plan = CompressPlan { rate_stiffening, ..person.plan(15.0, 50.0).unwrap() };
            let made = ready.compressed(&plan).unwrap();
            assert_eq!(made.met.as_deref(), Some("thickness_mm"), "{:?}", made.stopped_early);
            made.curve.force_n
        });
        println!("{soft:.5?} {stiff:.5?}");
        assert_eq!(stiff.len(), soft.len());
        for (stiff, soft) in stiff.iter().zip(&soft) {
            assert!((stiff / 11.0 - soft).abs() <= 1e-3 * soft.abs(), "{stiff} {soft}");
        }
    }
}
