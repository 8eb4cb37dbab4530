//! `study paddles`, `study positions` and `study designs` on the tiny volunteer, from outside.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

fn mammotwin(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mammotwin")).args(arguments).output().unwrap()
}

#[track_caller]
fn printed(arguments: &[&str]) -> String {
    let output = mammotwin(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The rows of a table by their first column; no value has a comma or a line break here.
fn rows(path: &Path) -> BTreeMap<String, BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), head.len(), "{line}");
        let named =
            head.iter().zip(&cells).map(|(name, cell)| (name.to_string(), cell.to_string()));
        (cells[0].to_owned(), named.collect())
    };
    lines.map(row).collect()
}

#[test]
fn one_breast_is_compressed_in_several_ways_and_only_once() {
    let folder = tempfile::tempdir().unwrap();
    let study = volunteer(folder.path());
    let text = fs::read_to_string(&study).unwrap();
    fs::write(
        &study,
        text.replace("paddle = \"rigid\"", "paddle = \"rigid\"\nstart_pose = \"prone\""),
    )
    .unwrap();
    let study = study.to_str().unwrap();

    let paddles = ["study", "paddles", study, "--paddles", "rigid,elastic,curved", "--no-picture"];
    let said = printed(&paddles);
    assert!(!said.starts_with("0 of "), "{said}");
    let place = folder.path().join("volunteer/out/studies/paddles");
    let table = rows(&place.join("paddles.csv"));
    assert_eq!(table.len(), 3);
    let number = |way: &str, name: &str| table[way][name].parse::<f64>().unwrap();
    for way in ["rigid", "elastic", "curved"] {
        assert_eq!(table[way]["ended_by"], "thickness_mm", "{way}");
        assert!(number(way, "force_n") > 0.0);
        // The mean is over the area that the CSV names: N over cm² is 10 kPa.
        let mean = 10.0 * number(way, "force_n") / number(way, "contact_area_cm2");
        assert!((mean / number(way, "mean_pressure_kpa") - 1.0).abs() < 1e-3, "{way}: {mean}");
        let share = number(way, "juxtathoracic_share");
        assert!((0.0..=1.0).contains(&share), "{share}");
        assert!(number(way, "mean_pressure_kpa") < number(way, "face_peak_pressure_kpa"));
    }
    assert!(number("elastic", "deflection_mm") > 0.0 && number("rigid", "deflection_mm") == 0.0);
    assert!(number("curved", "force_n") < number("rigid", "force_n"));
    for file in ["curves.csv", "comparisons.csv", "paddles.html", "force.svg", "mat_curved.png"] {
        assert!(fs::metadata(place.join(file)).unwrap().len() > 100, "{file}");
    }
    let page = fs::read_to_string(place.join("paddles.html")).unwrap();
    let elements = "Linear elements of 15 mm, law gent, J";
    assert!(page.contains(elements) && said.contains(elements), "{said}");
    assert!(table.values().all(|row| row["mesh_mm"] == "15" && row["law"] == "gent"));
    assert!(page.contains("137.21") && page.contains("Effect size") && !page.contains("src=\"/"));

    // Forms are compared with what is published, forces that are not reached are not.
    let trends = fs::read_to_string(place.join("trends.csv")).unwrap();
    assert!(page.contains("Published compressions") && page.contains("are not comparable"));
    for way in ["rigid", "elastic", "curved"] {
        let of = |what: &str| {
            let start = format!("{way},\"{what}");
            trends.lines().find(|line| line.starts_with(&start)).unwrap_or_default().to_owned()
        };
        assert!(of("h/h₀ at 100 N").contains("not reached"), "{trends}");
        assert!(!of("fall of thickness").is_empty(), "{trends}");
    }
    // A plate that bends is none of the published flexible paddles, which turn.
    assert!(
        trends.contains("rigid,\"force over contact area") && !trends.contains("flexible over")
    );

    // All is there: the same files.
    let before = fs::read(place.join("paddles.csv")).unwrap();
    let said = printed(&paddles);
    assert!(said.starts_with("0 of "), "{said}");
    assert_eq!(fs::read(place.join("paddles.csv")).unwrap(), before);

    // Clamping needs no other compression, and follows it in time.
    let text = fs::read_to_string(study).unwrap();
    fs::write(
        study,
        text.replace("paddle = \"rigid\"", "clamp = { clamp_s = 5.0 }\npaddle = \"rigid\""),
    )
    .unwrap();
    let said = printed(&paddles);
    assert!(said.starts_with("3 of "), "{said}");
    let table = rows(&place.join("paddles.csv"));
    let course = lines(&place.join("time_courses.csv"));
    for way in ["rigid", "elastic", "curved"] {
        let number = |name: &str| table[way][name].parse::<f64>().unwrap();
        let [start, end] = ["clamp_force_start_n", "clamp_force_end_n"].map(number);
        assert!(start > end && end > number("force_n"), "{way}: {start} {end}");
        assert!(number("force_n") / number("clamp_elastic_force_n") > 0.999);
        let own: Vec<_> = course.iter().filter(|line| line["way"] == way).collect();
        let last = |name: &str| own.last().unwrap()[name].parse::<f64>().unwrap();
        assert_eq!((last("time_s"), last("force_n")), (14.5, 0.0), "{way}");
        assert!(last("breast_mm") < last("thickness_mm"), "{way}");
    }

    designs_are_judged(study, folder.path());
    studies_are_compared(study, folder.path());

    // One distance is too far: it is named, the others are found.
    let said = printed(&[
        "study",
        "positions",
        study,
        "--distances",
        "190,20,15",
        "--paddles",
        "rigid",
        "--no-picture",
    ]);
    assert!(said.contains("rigid_190mm") && said.contains("failed"), "{said}");
    let table =
        fs::read_to_string(folder.path().join("volunteer/out/studies/positions/positions.csv"))
            .unwrap();
    assert_eq!(table.lines().count(), 4, "{table}");
    // Nearer to the chest wall there is more to press.
    let table = rows(&folder.path().join("volunteer/out/studies/positions/positions.csv"));
    let number = |way: &str, name: &str| table[way][name].parse::<f64>().unwrap();
    for name in ["force_n", "paddle_peak_pressure_kpa"] {
        assert!(number("rigid_15mm", name) > 1.2 * number("rigid_20mm", name), "{name}");
    }

    // What moduli, Jₘ and place leave open stands beside each way.
    let text = fs::read_to_string(study).unwrap();
    fs::write(study, format!("{text}\n[comfort]\nuncertainty = true\n")).unwrap();
    let said = printed(&["study", "paddles", study, "--paddles", "rigid", "--no-picture"]);
    assert!(said.contains(" ± "), "{said}");
    let table = rows(&place.join("paddles.csv"));
    let number = |name: &str| table["rigid"][name].parse::<f64>().unwrap();
    for name in ["force_n", "peak_pressure_kpa", "pressure_p95_kpa"] {
        let [value, sd] = [name, &format!("{name}_sd")].map(number);
        assert!(sd > 0.0 && sd < value, "{name}: {value} ± {sd}");
    }
    let page = fs::read_to_string(place.join("paddles.html")).unwrap();
    assert!(page.contains(" ± ") && page.contains("rigid: fitted moduli ("), "{said}");

    let unknown = mammotwin(&["study", "paddles", study, "--paddles", "soft"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("rigid, flex, elastic"));
}

/// Compressions of two studies: what is there is taken, and the differences are those of one study of both.
fn studies_are_compared(study: &str, folder: &Path) {
    let text = fs::read_to_string(study).unwrap();
    let other = PathBuf::from(study).with_file_name("curved,2.toml");
    fs::write(&other, text.replace("paddle = \"rigid\"", "paddle = \"curved\"")).unwrap();
    let other = other.to_str().unwrap();
    let out = folder.join("compared");
    let compare =
        ["study", "compare", study, other, "--no-picture", "--out", out.to_str().unwrap()];
    printed(&compare);
    let said = printed(&compare);
    assert!(said.starts_with("0 of "), "{said}");
    let table = rows(&out.join("compare.csv"));
    assert_eq!(table.keys().collect::<Vec<_>>(), ["curved-2", "study"]);
    assert_eq!(table["curved-2"]["paddle"], "curved");
    let text = |path: &Path| fs::read_to_string(path.join("comparisons.csv")).unwrap();
    let here = text(&out);
    let there = text(&Path::new(study).with_file_name("out/studies/paddles"));
    let same: Vec<String> = there
        .lines()
        .filter_map(|line| Some(format!("curved-2,study,{}", line.strip_prefix("curved,rigid,")?)))
        .collect();
    assert!(same.len() > 3);
    assert_eq!(here.lines().skip(1).collect::<Vec<_>>(), same);
    let page = fs::read_to_string(out.join("compare.html")).unwrap();
    assert!(page.contains("Compressions of several studies") && !page.contains("The thesis"));
    // Nothing is told apart by one study, or by names that are the same.
    assert_eq!(mammotwin(&["study", "compare", study]).status.code(), Some(2));
    let twice = mammotwin(&["study", "compare", study, study]);
    assert_eq!(twice.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&twice.stderr).contains("same file and folder name"));
}

/// Designs of the same breast: what is there is taken, what nothing beats is marked.
fn designs_are_judged(study: &str, folder: &Path) {
    let designs = folder.join("designs.toml");
    fs::write(&designs, "[soft]\npaddle = \"cushion\"\ncushion = { young_kpa = 5.0 }\n").unwrap();
    let out = folder.join("designs");
    let [file, place] = [&designs, &out].map(|path| path.to_str().unwrap());
    let asked = ["study", "designs", study, "--paddles", "rigid,curved", "--no-picture"];
    let asked = [&asked[..], &["--designs", file, "--out", place]].concat();
    let said = printed(&asked);
    assert!(said.starts_with("3 of "), "{said}");
    assert!(printed(&asked).starts_with("0 of "));
    let table = lines(&out.join("designs.csv"));
    let number = |n: usize, name: &str| table[n][name].parse::<f64>().unwrap();
    assert_eq!(table.len(), 3);
    for (n, way) in ["rigid", "curved", "soft"].iter().enumerate() {
        assert_eq!(
            (table[n]["way"].as_str(), table[n]["ended_by"].as_str()),
            (*way, "thickness_mm")
        );
        let costs = |n: usize| {
            [
                number(n, "paddle_peak_pressure_kpa"),
                number(n, "force_n"),
                -number(n, "in_view_share"),
            ]
        };
        let beaten = (0..3).any(|other| {
            let pairs = || costs(other).into_iter().zip(costs(n));
            pairs().all(|(a, b)| a <= b) && pairs().any(|(a, b)| a < b)
        });
        assert_eq!(table[n]["on_front"] == "0", beaten, "{way}: {said}");
        assert!((0.02..0.98).contains(&number(n, "in_view_share")), "{way}");
    }
    // Foam presses softer than the plate it lies on.
    let of = "paddle_peak_pressure_kpa";
    assert!(number(2, of) < number(0, of));
    for n in 0..3 {
        let both = number(n, "face_peak_pressure_kpa");
        assert!(number(n, of) <= both && both <= number(n, "peak_pressure_kpa") + 1e-6);
    }
    let page = fs::read_to_string(out.join("designs.html")).unwrap();
    assert!(page.matches("<svg").count() == 2 && page.contains("●"), "{page}");

    for (more, code, says) in [
        (&["--force-n", "2", "--thickness-mm", "46"][..], 2, "cannot be used with"),
        (&["--force-n", "0"], 2, "--force-n: give more than 0"),
        (&["--paddles", "rigid,soft"], 2, "there are"),
        (&["--size-mm", "10"], 2, "--size-mm: is for volunteers of --seeds"),
        (&["--seeds", "7", "--size-mm", "100"], 2, "give 2 to 50"),
    ] {
        let refused = mammotwin(&[&["study", "designs", study], more].concat());
        assert_eq!(refused.status.code(), Some(code));
        assert!(String::from_utf8_lossy(&refused.stderr).contains(says), "{refused:?}");
    }
    fs::write(&designs, "[soft]\npaddle = \"cushion\"\ncushion = { young_kpa = 0.0 }\n").unwrap();
    let refused = mammotwin(&asked);
    assert_eq!(refused.status.code(), Some(65));
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(
        text.contains("designs.toml") && text.contains("line 3: soft.cushion.young_kpa"),
        "{text}"
    );
    let refused = mammotwin(&["study", "designs"]);
    assert_eq!(refused.status.code(), Some(2));
}

/// Lines of a table, cell by cell under the heading.
fn lines(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head: Vec<String> = lines.next().unwrap().split(',').map(String::from).collect();
    lines
        .map(|line| head.iter().cloned().zip(line.split(',').map(String::from)).collect())
        .collect()
}

#[test]
fn the_error_of_the_model_is_mapped_without_a_hole_and_only_once() {
    let folder = tempfile::tempdir().unwrap();
    let study = volunteer(folder.path());
    let study = study.to_str().unwrap();
    let asked = ["study", "sensitivity", study, "--breast", "0.2,0.4,1", "--skin", "4,20"];
    let asked = [&asked[..], &["--fascia", "120"]].concat();
    let said = printed(&asked);
    assert!(said.contains("6 sets of moduli, 0 without an equilibrium"), "{said}");
    let place = folder.path().join("volunteer/out/studies/sensitivity");
    let errors = lines(&place.join("errors.csv"));
    assert_eq!(errors.len(), 12);
    let of = |breast: &str, skin: &str, column: &str| -> f64 {
        let here = |line: &&BTreeMap<String, String>| {
            line["breast_kpa"] == breast && line["skin_kpa"] == skin && line["pose"] == "prone"
        };
        errors.iter().find(here).unwrap()[column].parse().unwrap()
    };
    for line in &errors {
        assert!(line["round_trip_mm"].parse::<f64>().unwrap() < 0.05, "{line:?}");
    }
    // The volunteer's breasts are as soft as 0.2 and 0.3 kPa: stiffer ones do not sag enough.
    for side in ["mean_right_mm", "mean_left_mm"] {
        let [soft, middle, stiff] = ["0.2", "0.4", "1"].map(|breast| of(breast, "4", side));
        assert!(soft < middle && middle < stiff, "{side}: {soft} {middle} {stiff}");
        assert!(of("0.4", "20", side) > middle, "{side}");
    }
    let sweeps = lines(&place.join("sweeps.csv"));
    let largest = |parameter: &str| -> Vec<f64> {
        let own = sweeps.iter().filter(|line| line["parameter"] == parameter);
        own.map(|line| line["max_displacement_mm"].parse().unwrap()).collect()
    };
    // Stiffer moves less; Poisson's ratio hardly matters (Mira 2018, fig. 3.15).
    for parameter in ["breast", "skin"] {
        let all = largest(parameter);
        assert!(all.len() == 11 && all.windows(2).all(|pair| pair[1] < pair[0]), "{all:?}");
    }
    let poisson = largest("poisson");
    assert!(poisson.iter().all(|mm| (mm / poisson[0] - 1.0).abs() < 0.05), "{poisson:?}");
    let again = printed(&asked);
    assert!(again.starts_with("0 of "), "{again}");
    let page = fs::read_to_string(place.join("sensitivity.html")).unwrap();
    assert!(page.matches("<svg").count() == 12, "{}", page.matches("<svg").count());
    let refused = mammotwin(&["study", "sensitivity", study, "--skin", "4,-1"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--skin"));
}

/// Makes a person; returns her study.
fn volunteer(folder: &Path) -> PathBuf {
    let volunteer = folder.join("volunteer");
    let out = volunteer.to_str().unwrap();
    printed(&["synth", "--preset", "tiny", "--seed", "7", "--poses", "prone,supine", "--out", out]);
    volunteer.join("study.toml")
}

/// Writes the study of a volunteer again, with elements of a size, pressed from the prone shape.
fn meshed(study: &Path, size_mm: f64, name: &str) -> String {
    let text = fs::read_to_string(study).unwrap();
    let sized = text.replace("size_mm = 15.0", &format!("size_mm = {size_mm:.1}"));
    assert_ne!(sized, text);
    let text = sized.replace("paddle = \"rigid\"", "paddle = \"rigid\"\nstart_pose = \"prone\"");
    let path = study.with_file_name(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Force (N) at a thickness (mm) of the only course of a study of stiffening.
fn course(out: &Path) -> impl Fn(f64) -> f64 + use<> {
    let course: Vec<[f64; 2]> = lines(&out.join("studies/stiffening/curves.csv"))
        .iter()
        .map(|line| [&line["thickness_mm"], &line["force_n"]].map(|cell| cell.parse().unwrap()))
        .collect();
    move |h| {
        let n = course.windows(2).position(|pair| pair[0][0] >= h && pair[1][0] <= h).unwrap();
        let [from, to] = [course[n], course[n + 1]];
        from[1] + (from[0] - h) / (from[0] - to[0]) * (to[1] - from[1])
    }
}

/// Verifies: other breast foretold on another mesh from a record of the right one | its force, hidden | in the 90 % interval
#[test]
#[ignore = "ten minutes: fourteen compressions, twelve of them on a finer mesh"]
fn the_force_of_the_left_breast_lies_in_what_the_right_one_foretells() {
    let folder = tempfile::tempdir().unwrap();
    let study = volunteer(folder.path());
    let right = meshed(&study, 11.0, "truth.toml");
    let model = meshed(&study, 8.0, "model.toml");
    let left = study.with_file_name("left.toml");
    let text = fs::read_to_string(&right).unwrap();
    let turned = text.replace("side = \"right\"", "side = \"left\"");
    assert_ne!(turned, text);
    fs::write(&left, turned).unwrap();
    let asked = folder.path().join("asked.csv");
    fs::write(&asked, "thickness_mm,force_n\n52,1\n").unwrap();
    let asked = asked.to_str().unwrap();
    let run = |study: &str, name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let place = ["--out", out.to_str().unwrap()];
        let said = printed(&[&["study", "stiffening", study][..], &place, more].concat());
        (out, said)
    };
    let truth = ["--record", asked, "--jm", "1.3", "--distances", "13"];
    let seen = course(&run(&right, "right", &truth).0);
    let hidden = course(&run(left.to_str().unwrap(), "left", &truth).0);
    let mut record = String::from("thickness_mm,force_n\n");
    for (h, error) in [(68.0, 0.02), (64.0, -0.03), (60.0, 0.01), (56.0, -0.01), (53.0, 0.02)] {
        record += &format!("{h},{:.5}\n", seen(h) * (1.0 + error));
    }
    let path = folder.path().join("record.csv");
    fs::write(&path, record).unwrap();
    let known = ["--record", path.to_str().unwrap(), "--force-error-n", "0.005"];
    let grid = ["--thickness-error-mm", "0.3", "--jm", "0.8,1.3,2.2", "--distances", "11,15"];
    let (found, said) = run(&model, "model", &[&known[..], &grid, &["--other"]].concat());
    let foretold = lines(&found.join("studies/stiffening/foretold.csv"));
    let number = |line: &BTreeMap<String, String>, name: &str| line[name].parse::<f64>().unwrap();
    let mut held = Vec::new();
    for line in foretold.iter().filter(|line| number(line, "thickness_mm") < 64.0) {
        let h = number(line, "thickness_mm");
        if h < 53.0 {
            continue;
        }
        let [low, middle, high] =
            ["force_p05_n", "force_median_n", "force_p95_n"].map(|name| number(line, name));
        println!("{h} mm: {:.4} N, foretold {middle:.4} ({low:.4} to {high:.4}) N", hidden(h));
        // An interval that holds anything foretells nothing.
        assert!(high < 3.0 * middle, "{h} mm: {low} to {high} N\n{said}");
        held.push((low..=high).contains(&hidden(h)));
    }
    assert!(held.len() >= 3, "{said}");
    assert!(held.iter().all(|held| *held), "{held:?}\n{said}");
}

#[test]
#[ignore = "three minutes: fifteen compressions on a finer mesh"]
fn a_hidden_stretch_limit_and_place_lie_in_the_intervals_of_another_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let study = volunteer(folder.path());
    let truth = meshed(&study, 11.0, "truth.toml");
    let model = meshed(&study, 8.0, "model.toml");
    let hidden = (1.3, 13.0);
    // What the unit showed: Jm and place of the truth, read off with errors.
    let asked = folder.path().join("asked.csv");
    fs::write(&asked, "thickness_mm,force_n\n50,1\n").unwrap();
    let asked = asked.to_str().unwrap();
    let [far, near] = ["truth", "model"].map(|name| folder.path().join(name));
    let run = |study: &str, out: &Path, more: &[&str]| {
        let out = out.to_str().unwrap();
        printed(&[&["study", "stiffening", study, "--out", out], more].concat())
    };
    run(&truth, &far, &["--record", asked, "--jm", "1.3", "--distances", "13"]);
    let at = course(&far);
    let errors = [0.03, -0.02, 0.01, -0.03, 0.02, 0.0, -0.01, 0.02];
    let mut record = String::from("thickness_mm,force_n\n");
    for (h, error) in [70.0, 66.0, 62.0, 59.0, 56.0, 53.0, 51.0, 50.0].into_iter().zip(errors) {
        record += &format!("{h},{:.5}\n", at(h) * (1.0 + error));
    }
    let path = folder.path().join("record.csv");
    fs::write(&path, record).unwrap();
    let errors = ["--force-error-n", "0.005", "--thickness-error-mm", "0.3"];
    let grid = ["--jm", "0.7,1,1.4,2,3", "--distances", "11,13,15"];
    let said =
        run(&model, &near, &[&["--record", path.to_str().unwrap()][..], &errors, &grid].concat());
    println!("{said}");
    let weights = lines(&near.join("studies/stiffening/posterior.csv"));
    let number = |line: &BTreeMap<String, String>, name: &str| line[name].parse::<f64>().unwrap();
    // What is asked lies between 0.7 and 3, and between 11 and 15 mm: 90 % of these are 2.07 and 3.6 mm.
    let asked = [("jm", hidden.0, 2.07), ("chest_wall_distance_mm", hidden.1, 3.6)];
    for (column, truth, unknown) in asked {
        let below = |value: f64| -> f64 {
            let less = weights.iter().filter(|line| number(line, column) < value);
            less.map(|line| number(line, "weight")).sum()
        };
        let part = below(truth);
        assert!((0.05..0.95).contains(&part), "{column}: {part}\n{said}");
        // An interval of all that was asked would hold the truth as well.
        let mut values: Vec<f64> = weights.iter().map(|line| number(line, column)).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.iter().copied().find(|v| below(v + 1e-9) >= share).unwrap();
        let width = at(0.95) - at(0.05);
        assert!(width < 0.6 * unknown, "{column}: {width}\n{said}");
    }
}
