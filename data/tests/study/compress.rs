//! Compressions and designs of paddles.

use super::*;

#[test]
fn designs_of_paddles_change_what_belongs_to_them() {
    let plan = parse(GOOD).unwrap().compress.unwrap();
    let text = "[soft]\npaddle = \"cushion\"\ncushion = { young_kpa = 20.0 }\n\
                [\"hard-hinge\"]\npaddle = \"flex\"\nhinge = { linear_n_mm_per_rad = 1e5 }\nfriction = 0.2\n";
    let made = designs(text, &plan).unwrap();
    assert_eq!(made.keys().collect::<Vec<_>>(), ["hard-hinge", "soft"]);
    let soft = &made["soft"];
    assert_eq!(soft.cushion.unwrap().young_kpa, 20.0);
    assert_eq!((soft.stop, soft.friction), (plan.stop, plan.friction));
    assert_eq!((made["hard-hinge"].friction, made["hard-hinge"].cushion), (0.2, None));
    let sharp = designs("[sharp]\nedge_radius_mm = 3.0\n[plain]\n", &plan).unwrap();
    assert_eq!((sharp["sharp"].edge_radius_mm, sharp["plain"].edge_radius_mm), (3.0, 6.0));
    for (text, says) in [
        ("[soft]\nedge_radius_mm = 0.2\n", "line 2: soft.edge_radius_mm"),
        ("[soft]\npaddle = \"foam\"\n", "\"foam\" is not known"),
        ("[soft]\npadle = \"flex\"\n", "did you mean `paddle`"),
        ("[soft]\npaddle = \"flex\"\ncushion = {}\n", "line 3: soft.cushion: only a cushion"),
        ("[soft]\npaddle = \"cushion\"\ncushion = { young_kpa = 0.0 }\n", "soft.cushion.young_kpa"),
        ("[soft]\nfriction = 3.0\n", "line 2: soft.friction"),
        ("[\"a b\"]\n", "is not a name"),
        ("[c]\npaddle = \"cad\"\n", "line 2: c.paddle"),
    ] {
        let refused = designs(text, &plan).unwrap_err().to_string();
        assert!(refused.contains(says), "{refused:?} does not say {says:?}");
    }
}

#[test]
fn compressions_say_how_they_end_and_under_what() {
    let stop = "stop = { thickness_mm = 46.0 }";
    let with = |to: &str| parse(&GOOD.replacen(stop, to, 1)).unwrap().compress.unwrap();
    let all = "stop = { thickness_mm = 46.0, force_n = 90.0, mean_pressure_kpa = 10.0, \
               peak_pressure_kpa = 50.0 }";
    let plan = with(all).stop;
    assert_eq!((plan.force_n, plan.mean_pressure_kpa), (Some(90.0), Some(10.0)));
    assert_eq!(with("stop = { mean_pressure_kpa = 10.0 }").stop.thickness_mm, None);
    let gain = with("stop = { least_gain_mm_per_n = 0.1 }").stop;
    assert_eq!(gain.least_gain_mm_per_n, Some(0.1));
    refused(stop, "stop = { least_gain_mm_per_n = 0.0 }", &["compress.stop.least_gain_mm_per_n"]);
    // What is left out is not written: keys of earlier results stay.
    let plain = serde_json::to_string(&with(stop)).unwrap();
    for key in ["least_gain", "\"receptor\"", "\"file\""] {
        assert!(!plain.contains(key), "{plain}");
    }
    refused(stop, "stop = {}", &["compress.stop", "peak_pressure_kpa"]);
    refused(stop, "stop = { force_n = -1.0 }", &["compress.stop.force_n"]);
    refused(stop, "stop = { peak_pressure_kpa = nan }", &["compress.stop.peak_pressure_kpa"]);
    refused(stop, "stop = { pressure_kpa = 1.0 }", &["compress.stop", "unknown key"]);

    let clamped = |clamp: &str| format!("{stop}\nclamp = {{ {clamp} }}");
    assert_eq!(with(stop).clamp, None);
    let plan = with(&clamped("clamp_s = 5.0, held = \"force\"")).clamp.unwrap();
    assert_eq!((plan.ramp_s, plan.clamp_s, &plan.times_s[..]), (7.5, 5.0, &[3.2, 42.0][..]));
    for (clamp, says) in [
        ("ramp_s = 0.0", "clamp.ramp_s"),
        ("clamp_s = -1.0", "clamp.clamp_s"),
        ("release_s = nan", "clamp.release_s"),
        ("clamp_ms = 5.0", "name it `clamp_s`"),
        ("held = \"pressure\"", "clamp.held"),
        ("times_s = []", "give one to 8"),
        ("times_s = [42.0, 3.2]", "clamp.times_s[1]: 3.2 follows 42"),
        ("times_s = [3.2, 3.2]", "rising"),
        ("shares = [1.0]", "has 1 shares for 2 of times_s"),
        ("shares = [0.5, -0.5]", "clamp.shares[1]"),
        ("measured_in = \"vitro\"", "creep, relaxation"),
    ] {
        refused(stop, &clamped(clamp), &["compress.clamp", says]);
    }

    let rigid = "paddle = \"rigid\"";
    for (name, table, key) in [
        ("elastic", "plate = { thickness_mm = 0.0 }", "plate.thickness_mm"),
        ("curved", "curve = { rise_mm = -1.0 }", "curve.rise_mm"),
        ("tilting", "gimbal = { roll_n_mm_per_rad = 0.0 }", "gimbal.roll_n_mm_per_rad"),
        ("spot", "spot = { size_mm = 5.0 }", "spot.size_mm"),
        ("biopsy", "biopsy = { window_depth_mm = 500.0 }", "biopsy.window_depth_mm"),
        ("cushion", "cushion = { young_kpa = 0.0 }", "cushion.young_kpa"),
    ] {
        refused(rigid, &format!("paddle = \"{name}\"\n{table}"), &[&format!("compress.{key}")]);
        let (word, _) = table.split_once(' ').unwrap();
        let on_rigid = format!("paddle = \"rigid\"\n{word} = {{}}");
        refused(rigid, &on_rigid, &[&format!("compress.{word}"), name]);
        let text = GOOD.replacen(rigid, &format!("paddle = \"{name}\"\n{word} = {{}}"), 1);
        assert_eq!(parse(&text).unwrap().compress.unwrap().paddle.name(), name);
    }
    let spot = "paddle = \"spot\"\nspot = { shape = \"square\", corner_mm = 3.0 }";
    refused(rigid, spot, &["compress.spot.corner_mm"]);
    refused(rigid, "paddle = \"spot\"\nspot = { shape = \"oval\" }", &["compress.spot", "oval"]);
    refused(rigid, "paddle = \"spot\"\noutline = {}", &["compress.outline", "its own"]);
    refused(rigid, "paddle = \"flex\"\noutline = { corner_mm = 2.0 }", &["outline.corner_mm", "6"]);
    // Corners are no sharper than the edges, and windows leave twice their radius.
    refused(rigid, "paddle = \"rigid\"\nedge_radius_mm = 16.0", &["compress.edge_radius_mm", "15"]);
    let sharp = "paddle = \"flex\"\nedge_radius_mm = 8.0\noutline = { corner_mm = 7.0 }";
    refused(rigid, sharp, &["outline.corner_mm", "8"]);
    let near = "paddle = \"biopsy\"\nedge_radius_mm = 13.0";
    refused(rigid, near, &["compress.biopsy.away_mm", "leave 26 mm"]);
    let near = "paddle = \"biopsy\"\nbiopsy = { away_mm = 8.0 }";
    refused(rigid, near, &["compress.biopsy.away_mm", "8 mm of the plate", "12 mm"]);
    let wide = "paddle = \"biopsy\"\nbiopsy = { along_mm = 90.0 }";
    refused(rigid, wide, &["compress.biopsy.window_width_mm", "5 mm of the plate"]);
    refused(rigid, "paddle = \"cad\"", &["compress.paddle", "cad = { file"]);
    refused(rigid, "paddle = \"cad\"\ncad = {}", &["cad", "file"]);
    refused(rigid, "paddle = \"cad\"\ncad = { file = \"\" }", &["compress.cad.file"]);
    let cad = GOOD.replacen(rigid, "paddle = \"cad\"\ncad = { file = \"p.stl\" }", 1);
    let study = parse(&cad).unwrap();
    assert_eq!(study.compress.clone().unwrap().cad.unwrap().file.to_str(), Some("p.stl"));
    let bare = study.without_files().compress.unwrap();
    assert_eq!(bare.cad.as_ref().unwrap().file.to_str(), Some(""));
    assert!(bare.under(PaddleName::Cushion).cad.is_none());
    refused(rigid, "start_pose = \"tilted\"", &["compress.start_pose", "validate"]);
    refused(rigid, "start_pose = \"upright\"", &["compress.start_pose", "prone"]);
    refused("view = \"cc\"", "view_angle_deg = 45.0", &["compress.view_angle_deg", "mlo"]);
    let oblique = GOOD.replacen("view = \"cc\"", "view = \"mlo\"", 1);
    assert_eq!(parse(&oblique).unwrap().compress.unwrap().angle_deg(), 45.0);
    refused("[mammogram]", "[comfort]\nmat_pitch_mm = 0.0\n[mammogram]", &["comfort.mat_pitch_mm"]);
}
