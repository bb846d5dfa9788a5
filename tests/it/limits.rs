//! What is said where an error, a size or a memory cannot be met, and that it helps to do what is said.

use vdbake::field::{Field, Lattice};
use vdbake::march::TubeBounds;
use vdbake::scene::Scene;

use crate::accuracy::{real, windowed};
use crate::cli::{Folder, code, errors, number};

/// The amount after an option in a hint.
fn named(told: &str, option: &str) -> String {
    let hint = told.lines().find(|line| line.starts_with("hint: ") && line.contains(option));
    let rest = hint.and_then(|hint| hint.split(option).nth(1));
    let amount = rest.and_then(|rest| rest.split([' ', ',']).find(|word| !word.is_empty()));
    amount.unwrap_or_else(|| panic!("no {option} is named: {told}")).to_owned()
}

#[test]
fn half_precision_is_blamed_for_what_it_does() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(1));
    // Of numbers rounded to 11 digits: 2^-11 / sqrt(12) of each at least, and 2^-12 / sqrt(3) at most.
    let bake = ["bake", "asked.toml", "-o", "a.vdb", "--max-error", "1e-4", "--precision", "f16", "--quiet"];
    let output = folder.run(&bake);
    let told = errors(&output);
    assert_eq!(code(&output), 1, "{told}");
    assert!(told.contains("values in half precision are too coarse for a relative L2 of 1.000e-4"), "{told}");
    assert!(told.contains("--precision f32") && !told.contains("kinks"), "{told}");
    // What it does allow it is no hindrance to.
    let bake = ["bake", "asked.toml", "-o", "a.vdb", "--max-error", "0.01", "--precision", "f16"];
    assert!(real(&folder.json(&bake)["certificate"]["goal"]["at_most"]) <= 0.01);
}

#[test]
fn of_an_error_and_a_size_it_is_said_which_decides() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(3));
    let bake = |options: &[&str]| {
        folder.run(&[&["bake", "asked.toml", "-o", "a.vdb", "--max-bytes", "300kB"][..], options].concat())
    };
    let output = bake(&["--max-error", "0.005"]);
    let told = errors(&output);
    assert_eq!(code(&output), 1, "{told}");
    assert!(told.contains("--max-bytes is too small for --max-error"), "{told}");
    assert!(!folder.made().contains(&"a.vdb".to_owned()));
    // What the bytes are enough for, which is no more than there need be.
    let within = named(&told, "hint: --max-error ");
    let output = bake(&["--max-error", &within, "--json"]);
    let told = errors(&output);
    assert_eq!(code(&output), 0, "{told}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let bytes = number(&report["bytes"]);
    assert!((100_000..=300_000).contains(&bytes), "{bytes}");
    assert!(real(&report["certificate"]["goal"]["at_most"]) <= within.parse().expect("a number"));
    assert!(told.contains("the error decides, with a file of about"), "{told}");
    let output = bake(&[]);
    assert!(errors(&output).contains("m are tried for a file of about"), "{}", errors(&output));
}

#[test]
fn memory_that_is_named_is_enough() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(2));
    for arguments in [
        // To plan, to plan a bake, to find a voxel size, and to measure.
        &["plan", "asked.toml", "--voxel-size", "0.002", "--memory", "12MiB"][..],
        &["plan", "asked.toml", "--voxel-size", "0.002", "--memory", "20MiB"],
        &["bake", "asked.toml", "-o", "a.vdb", "--max-error", "0.01", "--memory", "20MiB"],
        &["bake", "asked.toml", "-o", "a.vdb", "--voxel-size", "0.008", "--certify", "--memory", "24MiB"],
        &["sample", "asked.toml", "--points", "points.csv", "--voxel-size", "0.001", "--memory", "1MiB"],
    ] {
        folder.put("points.csv", "0,0,0\n0.1,0.1,0.1\n");
        let output = folder.run(&[arguments, &["--quiet"]].concat());
        let told = errors(&output);
        assert_eq!(code(&output), 1, "{arguments:?}: {told}");
        let amount = named(&told, "--memory ");
        let mut again = arguments.to_vec();
        let last = again.len() - 1;
        again[last] = &amount;
        let output = folder.run(&[&again[..], &["--quiet"]].concat());
        assert_eq!(code(&output), 0, "{again:?}: {}", errors(&output));
    }
    let output = folder.run(&["verify", "a.vdb", "--memory", "20MiB"]);
    let told = errors(&output);
    assert_ne!(code(&output), 0, "{told}");
    assert_eq!(code(&folder.run(&["verify", "a.vdb", "--memory", &named(&told, "--memory ")])), 0);
}

#[test]
fn optical_depths_have_an_interval_that_is_kept() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(1));
    let bake =
        ["bake", "asked.toml", "-o", "a.vdb", "--max-error", "0.01", "--error-metric", "optical-depth"];
    let report = folder.json(&bake);
    let goal = &report["certificate"]["goal"];
    let held = &report["certificate"]["measured"]["optical_depth"]["relative_l2"];
    let (achieved, at_most) = (real(&goal["achieved"]), real(&goal["at_most"]));
    let [low, high] = [real(&held[0]), real(&held[1])];
    assert!(low < achieved && achieved < high && high == at_most && at_most <= 0.01, "{goal} {held}");
    // Of 2000 rays: some percent to either side.
    assert!(high < 1.2 * low && achieved >= 0.7 * 0.01, "{goal} {held}");
    assert_eq!(code(&folder.run(&["verify", "a.vdb", "--quiet"])), 0);
}

#[test]
fn what_is_far_too_long_for_its_radius_is_refused_at_once() {
    let folder = Folder::new();
    let far = "[[tube]]\nradius = 1.0\ncurve = { points = [[0, 0, 0], [1e8, 0, 4e8], [0, 0, 9e8]] }\n";
    folder.put("far.toml", far);
    for metric in ["l2", "max", "optical-depth", "mass"] {
        let bake = ["bake", "far.toml", "--max-error", "0.05", "--error-metric", metric, "--quiet"];
        let output = folder.run(&bake);
        let told = errors(&output);
        assert_eq!(code(&output), 1, "{told}");
        assert!(told.contains("along the longest side, too many"), "{told}");
    }
    // It is bounded all the same.
    let field = Field::compile(&Scene::parse(far, "far.toml").expect("valid"));
    assert!(TubeBounds::new(&field, Lattice { voxel_size: 1e6 }).bodies() > 0);
    // Beyond all numbers of voxels.
    let away = "[[tube]]\nradius = 0.3\ncurve = { points = [[9e8, 0, 0], [9e8, 0.1, 0.5], [9e8, 0, 1]] }\n";
    folder.put("away.toml", away);
    let output = folder.run(&["bake", "away.toml", "--max-error", "0.05", "--quiet"]);
    assert_eq!(code(&output), 1);
    assert!(errors(&output).contains("move the scene nearer to the origin"), "{}", errors(&output));
}

#[test]
fn voxels_far_too_small_are_refused_with_a_size_that_fits() {
    let folder = Folder::new();
    folder.put(
        "long.toml",
        "[[tube]]\nradius = 0.3\ncurve = { points = [[0, 0, 0], [0.2, 0, 1], [0, 0, 2]] }\n",
    );
    for size in ["1e-4", "1e-6"] {
        let output = folder.run(&["plan", "long.toml", "--voxel-size", size, "--memory", "160MiB"]);
        let told = errors(&output);
        assert_eq!(code(&output), 1, "{told}");
        let fits = named(&told, "--voxel-size ");
        let output = folder.run(&["plan", "long.toml", "--voxel-size", &fits, "--memory", "160MiB"]);
        assert_eq!(code(&output), 0, "{fits}: {}", errors(&output));
    }
}

#[test]
fn curves_too_long_for_the_memory_are_refused_before_it_is_taken() {
    let folder = Folder::new();
    let points: String = (0..20_000).map(|i| format!("[{}, {}, {}], ", i % 2, i % 3, i)).collect();
    folder.put(
        "long.toml",
        format!("[[tube]]\nradius = 0.1\ncurve = {{ kind = \"catmull-rom\", points = [{points}] }}\n"),
    );
    let plan = |memory: &str| {
        folder.run(&["plan", "long.toml", "--voxel-size", "10", "--memory", memory, "--quiet"])
    };
    let output = plan("32MiB");
    let told = errors(&output);
    assert_eq!(code(&output), 1, "{told}");
    assert!(told.contains("19,999 segments take about"), "{told}");
    let output = plan(&named(&told, "--memory "));
    assert_eq!(code(&output), 0, "{}", errors(&output));
}

/// What is said to be enough is, at once, and less than twice the least that does.
#[test]
fn the_first_memory_that_is_named_is_enough_and_little_more() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(2));
    let thread: String =
        (0..600).map(|i| format!("[{}, {}, {}], ", i * 7 % 11, i * 5 % 13, i * 3 % 17)).collect();
    folder.put(
        "thread.toml",
        format!("[[tube]]\nradius = 0.05\ncurve = {{ kind = \"catmull-rom\", points = [{thread}] }}\n"),
    );
    folder.json(&["bake", "asked.toml", "-o", "a.vdb", "--resolution", "300"]);
    folder.put("points.csv", "0,0,0\n0.1,0.1,0.1\n");
    folder.put("many.csv", "0.1,0.1,0.1\n".repeat(200_000));
    for arguments in [
        &["plan", "asked.toml", "--resolution", "900"][..],
        &["plan", "thread.toml", "--resolution", "1500"],
        &["check", "asked.toml", "--resolution", "900"],
        &["check", "thread.toml", "--resolution", "1500"],
        &["sample", "asked.toml", "--points", "points.csv", "--resolution", "900"],
        &["sample", "thread.toml", "--points", "many.csv", "--resolution", "1500"],
        &["sample", "thread.toml", "--points", "many.csv", "--exact"],
        &["sample", "a.vdb", "--points", "points.csv"],
        &["sample", "a.vdb", "--points", "many.csv"],
        &["compare", "asked.toml", "a.vdb", "--resolution", "900", "--points", "1000"],
        &["compare", "a.vdb", "a.vdb"],
    ] {
        let run = |memory: &str| {
            let output = folder
                .run(&[arguments, &["--json", "--quiet", "--threads", "2", "--memory", memory]].concat());
            (code(&output), errors(&output), output.stdout)
        };
        let (refused, told, _) = run("1MiB");
        assert_eq!(refused, 1, "{arguments:?}: {told}");
        let amount = named(&told, "--memory ");
        let (done, told, report) = run(&amount);
        assert_eq!(done, 0, "{arguments:?} {amount}: {told}");
        if cfg!(target_os = "linux") {
            let report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
            // Those of the others are the same on every run.
            if ["check", "sample"].contains(&arguments[0]) {
                let peak = number(&report["peak_rss_bytes"]);
                assert!(peak <= mebibytes(&amount) << 20, "{arguments:?}: {peak} bytes within {amount}");
            }
        }
        let less = format!("{}MiB", mebibytes(&amount) / 2);
        assert_eq!(run(&less).0, 1, "{arguments:?}: {less} is enough, and {amount} was named");
    }
}

fn mebibytes(amount: &str) -> u64 {
    amount.strip_suffix("MiB").and_then(|amount| amount.parse().ok()).expect("MiB")
}

/// Whatever is allowed: it is refused, or enough.
#[test]
fn no_memory_is_exceeded_by_what_is_not_refused() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(2));
    let lamps = "[[light]]\nkind = \"sun\"\n[[light]]\nkind = \"point\"\nposition = [2, 2, 2]\n";
    folder.put("lit.toml", format!("{}\n{lamps}", windowed(2)));
    folder.json(&["bake", "lit.toml", "-o", "a.vdb", "--resolution", "300"]);
    folder.put("many.csv", "0.1,0.1,0.1\n".repeat(200_000));
    for arguments in [
        &["check", "asked.toml", "--resolution", "900"][..],
        &["sample", "asked.toml", "--points", "many.csv", "--resolution", "900"],
        &["sample", "asked.toml", "--points", "many.csv", "--exact"],
        &["sample", "a.vdb", "--points", "many.csv"],
        &["render", "lit.toml", "-o", "a.png", "--size", "64x64", "--resolution", "300"],
        &[
            "render",
            "lit.toml",
            "-o",
            "a.png",
            "--size",
            "640x640",
            "--shadow",
            "none",
            "--resolution",
            "900",
        ],
        &["render", "a.vdb", "-o", "a.png", "--size", "64x64", "--shadow-step", "1"],
    ] {
        let mut done = false;
        for memory in (16..22).chain([24, 28, 33, 40, 52, 70, 100, 150, 250, 400]) {
            let amount = format!("{memory}MiB");
            let output = folder
                .run(&[arguments, &["--json", "--quiet", "--threads", "2", "--memory", &amount]].concat());
            let told = errors(&output);
            if code(&output) != 0 {
                assert!(code(&output) == 1 && told.contains("--memory "), "{arguments:?} {amount}: {told}");
                continue;
            }
            done = true;
            if cfg!(target_os = "linux") {
                let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
                let peak = number(&report["peak_rss_bytes"]);
                assert!(peak <= memory << 20, "{arguments:?}: {peak} bytes within {amount}");
            }
        }
        assert!(done, "{arguments:?}: never");
    }
}
