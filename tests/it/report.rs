//! `vdbake report`: what each accuracy costs.

use serde_json::Value;

use crate::cli::{Folder, code, errors, number, text};

fn real(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A quick report.
const QUICK: [&str; 7] = ["--points", "5000", "--size", "48x27", "--repeats", "2", "--quiet"];

fn rows<'a>(report: &'a Value, group: &str) -> Vec<&'a Value> {
    report["rows"].as_array().expect("rows").iter().filter(|row| row["group"] == group).collect()
}

#[test]
fn every_axis_has_its_rows_with_errors_and_times() {
    let folder = Folder::new();
    let arguments = [&["report", "bent.toml", "-o", "out.json", "--time-limit", "600"][..], &QUICK].concat();
    let report = folder.json(&arguments);
    assert_eq!(serde_json::from_slice::<Value>(&folder.get("out.json")).expect("JSON"), report);
    assert_eq!((&report["version"], &report["left_out"]), (&1.into(), &Value::Array(vec![])));
    for (group, count) in [
        ("voxel size and filter", 30),
        ("precision and codec", 5),
        ("octaves", 5),
        ("baked", 3),
        ("steps", 8),
        ("paper", 5),
        ("growing step", 2),
        ("mapping", 3),
        ("entry", 3),
        ("density sum", 5),
        ("intervals", 6),
        ("early exit", 2),
        ("frame", 2),
        ("conservation", 3),
        ("overlap", 4),
        ("segments", 10),
    ] {
        assert_eq!(rows(&report, group).len(), count, "{group}");
    }
    for row in report["rows"].as_array().expect("rows") {
        let total = &row["cost"]["total"];
        let [least, median, most] = ["least", "median", "most"].map(|part| real(&total[part]));
        assert!(0.0 < least && least <= median && median <= most && number(&total["count"]) == 2, "{row}");
        let is_picture = row["kind"] == "picture";
        assert_eq!(row["image"].is_object(), is_picture, "{row}");
        if is_picture {
            // The figure is one that squares of its pixels would give.
            for figure in ["rmse", "relative", "psnr", "flip"] {
                let [low, high] = [0, 1].map(|end| real(&row["image"]["intervals"][figure][end]));
                let value = real(&row["image"][figure]);
                assert!(low <= value && value <= high && low < high, "{figure}: {row}");
            }
            // The fourth root of 48 * 27, rounded up.
            assert_eq!(row["image"]["intervals"]["block"], 6);
        }
        // Both axes, whatever it is held against.
        assert_eq!(row["field"]["errors"]["l2"]["of_rms"].is_number(), !is_picture, "{row}");
        let altered = ["frame", "conservation", "overlap", "segments", "paper"]
            .iter()
            .any(|group| row["group"] == *group);
        let is_other = row["label"].as_str().is_some_and(|label| label.starts_with("a helix"));
        assert_eq!(row["is_own"], !(altered || is_other), "{row}");
        assert!(row["on_front"] == false || (row["is_own"] == true && row["command"].is_string()), "{row}");
        assert!(
            is_picture || (number(&row["cost"]["bytes"]) > 0 && real(&row["cost"]["ns_per_voxel"]) > 0.0),
            "{row}"
        );
    }
    // Errors fall with the voxel size, for every filter.
    for filter in ["nearest", "trilinear", "cubic"] {
        let mut sizes: Vec<[f64; 2]> = rows(&report, "voxel size and filter")
            .into_iter()
            .filter(|row| row["settings"]["filter"] == filter)
            .map(|row| [real(&row["settings"]["voxel_size"]), real(&row["field"]["errors"]["l2"]["of_rms"])])
            .collect();
        sizes.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert!(sizes.windows(2).all(|pair| pair[0][1] < pair[1][1]), "{filter}: {sizes:?}");
    }
    // Codecs lose nothing, and half precision hardly anything.
    let l2 = |row: &Value| real(&row["field"]["errors"]["l2"]["of_rms"]);
    let own = rows(&report, "voxel size and filter").into_iter().find(|row| {
        row["settings"]["voxel_size"] == report["voxel_size"] && row["settings"]["filter"] == "trilinear"
    });
    let own = own.expect("the scene's own voxel size");
    for row in rows(&report, "precision and codec") {
        let same = row["settings"]["precision"] == "f32";
        // Half a unit in the last of eleven digits, beside an error of some percent.
        assert!((l2(row) - l2(own)).abs() <= if same { 0.0 } else { 1e-4 * l2(own) }, "{row}");
    }
    // Other frames make another density, and its bake is as near to that.
    let frames: Vec<f64> = rows(&report, "frame").into_iter().map(l2).collect();
    assert!(frames.iter().all(|error| (0.5..2.0).contains(&(error / frames[0]))), "{frames:?}");
    // Without octaves more is missing.
    let simpler = rows(&report, "octaves");
    assert!(l2(simpler[simpler.len() - 1]) > l2(own), "{simpler:?}");
    // Longer steps are no better; and nothing that is beaten is on a front.
    let step = |label: &str| {
        let row =
            rows(&report, "steps").into_iter().find(|row| row["label"] == label).expect("a row").clone();
        real(&row["image"]["rmse"])
    };
    assert!(step("gauss, 4 voxels a step") >= step("gauss, 0.5 voxels a step"));
    assert!(step("midpoint, quadruple step") > step("midpoint"));
    // A sum of more samples is nearer; and light is lost by shadows, which that leaves out.
    let transmittance = |label: &str| {
        let found = rows(&report, "density sum").into_iter().find(|row| row["label"] == label).cloned();
        real(&found.expect("a row")["image"]["transmittance"])
    };
    let [few, many] = ["5 samples a ray, no shadows", "256 samples a ray, no shadows"].map(transmittance);
    // The octaves that fade are missing in both.
    assert!(many < 0.5 * few, "{few}, {many}");
    let all = report["rows"].as_array().expect("rows");
    let level = |row: &Value| {
        let error = if row["kind"] == "bake" {
            row["field"]["errors"]["l2"]["of_rms"].as_f64()
        } else {
            row["image"]["relative"].as_f64()
        };
        Some([real(&row["cost"]["total"]["median"]), error?])
    };
    for row in all.iter().filter(|row| row["on_front"] == true) {
        let own = level(row).expect("on a front");
        let can_be_chosen = |other: &&Value| other["is_own"] == true && other["command"].is_string();
        let same = all.iter().filter(|other| other["kind"] == row["kind"]).filter(can_be_chosen);
        assert!(!same.filter_map(level).any(|other| other[0] < own[0] && other[1] < own[1]), "{row}");
    }
    for parts in ["parts", "parts_f16"] {
        let apart = (real(&report[parts]["of_whole"]) - 1.0).abs();
        assert!(apart <= 0.2 || report[parts]["reason"].is_string(), "{}", report[parts]);
    }
    for part in ["model", "interpolation", "quantisation", "early_exit", "step", "whole"] {
        assert!(real(&report["image_parts"][part]["rms"]) >= 0.0);
    }
    let apart = (real(&report["image_parts"]["of_whole"]) - 1.0).abs();
    assert!(apart <= 0.2 || report["image_parts"]["reason"].is_string(), "{}", report["image_parts"]);
    assert!(real(&report["pays_after"]["bake"]) > 0.0 && number(&report["machine"]["threads"]) > 0);
    let orders = report["orders"].as_array().expect("a list");
    assert_eq!(orders.len(), 12);
    for order in orders {
        // Never over sizes that do not show the density.
        let error = |size: f64| {
            let sizes = rows(&report, "voxel size and filter");
            let row = sizes.into_iter().find(|row| {
                row["settings"]["filter"] == order["filter"] && real(&row["settings"]["voxel_size"]) == size
            });
            l2(row.expect("a row"))
        };
        let sizes: Vec<f64> = order["voxel_sizes"].as_array().expect("a list").iter().map(real).collect();
        assert_eq!(order["measured"].is_null(), sizes.is_empty(), "{order}");
        assert!(sizes.is_empty() || sizes.len() >= 3 && order["why"].is_string(), "{order}");
        assert!(order["metric"] != "l2" || sizes.iter().all(|size| error(*size) <= 0.25), "{order}");
    }
}

#[test]
fn a_csv_has_a_line_for_each_row_and_time_is_kept() {
    let folder = Folder::new();
    let arguments = [&["report", "bent.toml", "-o", "out.csv", "--time-limit", "1"][..], &QUICK].concat();
    let report = folder.json(&arguments);
    let csv = String::from_utf8(folder.get("out.csv")).expect("text");
    let lines: Vec<&str> = csv.lines().collect();
    let rows = report["rows"].as_array().expect("rows").len();
    assert_eq!(lines.len(), rows + 1);
    let mut read = csv::Reader::from_reader(csv.as_bytes());
    let columns = read.headers().expect("a header").clone();
    for (line, row) in read.records().zip(report["rows"].as_array().expect("rows")) {
        // As many cells as columns, or it is an error.
        let line = line.expect("a line");
        let cell = |name: &str| {
            let at = columns.iter().position(|column| column == name).expect("a column");
            line.get(at).expect("a cell")
        };
        assert_eq!(
            [cell("group"), cell("label")],
            [&row["group"], &row["label"]].map(|x| x.as_str().expect("text"))
        );
        assert_eq!(cell("is_own") == "true", row["is_own"] == true);
        assert_eq!(cell("bytes").parse().ok(), row["cost"]["bytes"].as_u64());
        let flip = &row["image"]["intervals"]["flip"][1];
        assert_eq!(cell("image_flip_high").parse().ok(), flip.as_f64());
    }
    let left = report["left_out"].as_array().expect("a list");
    assert!(!left.is_empty() && left.iter().any(|what| what == "10000 segments"), "{left:?}");
    // In words: what is missing, too.
    let words = text(&folder.run(&arguments));
    assert!(words.contains("left out") && words.contains("orders"), "{words}");
}

#[test]
fn what_cannot_be_reported_is_refused() {
    let folder = Folder::new();
    let run = |arguments: &[&str]| folder.run(&[&["report", "bent.toml"][..], arguments].concat());
    for arguments in [
        &["-o", "out.pdf"][..],
        &["-o", "out.json", "--time-limit", "0"],
        &["-o", "out.json", "--size", "2x2"],
        &["-o", "out.json", "--points", "10"],
        &[],
    ] {
        assert_eq!(code(&run(arguments)), 2, "{arguments:?}");
    }
    // Pictures and points take more than the least, as much as was measured at the least.
    for (asked, measured) in [
        (["--size", "960x540"], "190MiB"),
        (["--size", "1920x1080"], "711MiB"),
        (["--points", "2000000"], "147MiB"),
    ] {
        let output = run(&[&["-o", "out.json", "--memory", measured][..], &asked].concat());
        assert_eq!(code(&output), 1, "{asked:?}");
        assert!(errors(&output).contains("allow more with --memory"), "{}", errors(&output));
    }
    let fine = run(&["-o", "out.json", "--voxel-size", "1e-5", "--memory", "128MiB", "--quiet"]);
    assert_eq!(code(&fine), 1);
    assert!(errors(&fine).contains("take a larger --voxel-size"), "{}", errors(&fine));
}
