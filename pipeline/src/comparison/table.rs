//! Comparisons as CSV files.

use super::{Way, differences, shift_to_wall, trends::agreements};
use crate::page::quoted;
use mammotwin_data::study::{CompressLaw, MeshPlan};
use std::fmt::Write;

/// What the numbers of all ways depend on: elements and the law in compression.
pub fn stated(mesh: &MeshPlan, law: &CompressLaw) -> String {
    let jm = law.jm.map_or(String::new(), |jm| format!(", Jₘ {jm}"));
    format!(
        "Linear elements of {} mm, law {}{jm}, Poisson's ratio {} in compression. Forces and pressures depend on all of \
         these: compare them on equal ones only; on elements of 14 mm forces are up to twice those on 8 mm.",
        mesh.size_mm,
        law.name.name(),
        law.poisson
    )
}

/// One row a way: how it was compressed, how that ended, all metrics, their standard deviations where there are some.
pub fn summary(ways: &[Way]) -> String {
    // What any has, in the order in which it comes.
    let mut names: Vec<&str> = Vec::new();
    for metric in ways.iter().flat_map(|way| &way.found).flat_map(|found| &found.metrics) {
        if !names.contains(&metric.name.as_str()) {
            names.push(&metric.name);
        }
    }
    let found = || ways.iter().filter_map(|way| way.found.as_ref().ok());
    let uncertain: Vec<&str> =
        names.iter().copied().filter(|name| found().any(|f| f.sd(name).is_finite())).collect();
    let mut text = String::from(
        "way,paddle,chest_wall_distance_mm,mesh_mm,law,jm,poisson,ended_by,stopped_early",
    );
    for name in &names {
        // Writing to a string does not fail.
        let _ = write!(text, ",{name}");
    }
    for name in &uncertain {
        let _ = write!(text, ",{name}_sd");
    }
    text.push('\n');
    for way in ways {
        let (paddle, distance) = (way.plan.paddle.name(), way.plan.chest_wall_distance_mm);
        let law = &way.plan.law;
        let jm = law.jm.map_or(String::new(), |jm| jm.to_string());
        let of = format!("{},{},{jm},{}", way.mesh_mm, law.name.name(), law.poisson);
        let _ = write!(text, "{},{paddle},{distance},{of}", way.label);
        match &way.found {
            Ok(found) => {
                let met = found.compression.met.as_deref().unwrap_or_default();
                let early = found.compression.stopped_early.as_deref().unwrap_or_default();
                let _ = write!(text, ",{met},{}", quoted(early));
                let values = names.iter().map(|name| found.metric(name));
                for value in values.chain(uncertain.iter().map(|name| found.sd(name))) {
                    let _ = if value.is_finite() {
                        write!(text, ",{value:.6}")
                    } else {
                        write!(text, ",")
                    };
                }
            }
            Err(why) => {
                let _ =
                    write!(text, ",,{}{}", quoted(why), ",".repeat(names.len() + uncertain.len()));
            }
        }
        text.push('\n');
    }
    text
}

/// The courses of all ways, one row a state.
pub fn curves(ways: &[Way]) -> String {
    let mut text = String::from(
        "way,thickness_mm,force_n,receptor_force_n,tilt_deg,roll_deg,deflection_mm,bulge_mm,\
         moved_mm,contact_area_mm2,front_area_mm2,edge_area_mm2,mean_pressure_kpa,peak_pressure_kpa,\
         paddle_peak_pressure_kpa\n",
    );
    for way in ways {
        let Ok(found) = &way.found else { continue };
        let c = &found.compression.curve;
        for n in 0..c.thickness_mm.len() {
            let _ = writeln!(
                text,
                "{},{:.3},{:.6},{:.6},{:.4},{:.4},{:.4},{:.4},{:.4},{:.2},{:.2},{:.2},{:.6},{:.6},{:.6}",
                way.label,
                c.thickness_mm[n],
                c.force_n[n],
                c.receptor_force_n[n],
                c.tilt_deg[n],
                c.roll_deg[n],
                c.deflection_mm[n],
                c.bulge_mm[n],
                c.moved_mm[n],
                c.contact_area_mm2[n],
                c.front_area_mm2[n],
                c.edge_area_mm2[n],
                c.mean_pressure_kpa[n],
                c.peak_pressure_kpa[n],
                c.paddle_peak_pressure_kpa[n]
            );
        }
    }
    text
}

/// The courses in time of all ways, one row a moment; only the heading when none is clamped.
pub fn time_courses(ways: &[Way]) -> String {
    let mut text = String::from(
        "way,time_s,thickness_mm,breast_mm,force_n,elastic_force_n,mean_pressure_kpa\n",
    );
    for way in ways {
        let Some(c) = way.found.as_ref().ok().and_then(|found| found.course.as_ref()) else {
            continue;
        };
        for n in 0..c.time_s.len() {
            let _ = writeln!(
                text,
                "{},{:.3},{:.4},{:.4},{:.6},{:.6},{:.6}",
                way.label,
                c.time_s[n],
                c.thickness_mm[n],
                c.breast_mm[n],
                c.force_n[n],
                c.elastic_force_n[n],
                c.mean_pressure_kpa[n]
            );
        }
    }
    text
}

/// Every way against the first that was found.
pub fn comparisons(ways: &[Way]) -> String {
    let mut text = String::from(
        "way,against,what,mean_of_first,mean,difference,effect_size,overlap,p_welch,p_mann_whitney\n",
    );
    let mut found = ways.iter().filter_map(|way| Some((way, way.found.as_ref().ok()?)));
    let Some((base, first)) = found.next() else { return text };
    for (way, other) in found {
        for one in differences(first, other) {
            let c = one.comparison;
            let [welch, ranks] = one.p.map(|p| p.map_or(String::new(), |p| format!("{p:.4}")));
            let _ = writeln!(
                text,
                "{},{},{},{:.6},{:.6},{:.6},{:.4},{:.4},{welch},{ranks}",
                way.label,
                base.label,
                quoted(&one.what),
                c.means[0],
                c.means[1],
                c.difference,
                c.effect_size,
                c.overlap
            );
        }
        if let Some([most, p95]) = shift_to_wall(&first.compression, &other.compression) {
            for (what, value) in [("largest", most), ("95 %", p95)] {
                let what = format!("shift of tissue towards the chest wall (mm), {what}");
                let (label, base) = (&way.label, &base.label);
                let _ = writeln!(text, "{label},{base},{},0,,{value:.4},,,,", quoted(&what));
            }
        }
    }
    text
}

/// Published numbers beside ours; `agrees` is empty where they cannot be compared.
pub fn trends_csv(ways: &[Way], juxtathoracic_mm: f64) -> String {
    let found: Vec<_> =
        ways.iter().filter_map(|way| Some((way, way.found.as_ref().ok()?))).collect();
    let mut text = String::from("way,what,published,ours,agrees,source\n");
    for one in agreements(&found, juxtathoracic_mm) {
        let agrees = one.agrees.map_or("", |yes| if yes { "1" } else { "0" });
        let [what, published, ours, source] =
            [&one.what, &one.published, &one.ours, &one.source].map(|text| quoted(text));
        let _ = writeln!(text, "{},{what},{published},{ours},{agrees},{source}", one.way);
    }
    text
}
