//! Ways to march, on the command line.

use serde_json::Value;

use crate::cli::Folder;

#[test]
fn methods_draw_scenes_and_say_where_they_have_no_meaning() {
    let folder = Folder::new();
    let draw = |options: &[&str]| {
        let all = [&["--json", "render", "bent.toml", "-o", "a.png", "--size", "48x32"], options].concat();
        let output = folder.run(&all);
        let message = String::from_utf8(output.stderr).expect("UTF-8");
        let told = serde_json::from_slice::<Value>(&output.stdout).ok();
        let mean = told.and_then(|told| told["mean_transmittance"].as_f64());
        (output.status.code().expect("an exit code"), mean, message)
    };
    let (code, truth, _) = draw(&["--step", "0.25"]);
    let truth = truth.expect("a mean");
    assert_eq!(code, 0);
    for options in [
        &["--method", "gauss"][..],
        &["--method", "midpoint"],
        &["--method", "alpha", "--entry", "constant"],
        &["--method", "midpoint", "--entry", "converging", "--growth", "0.01"],
        &["--method", "midpoint", "--entry", "sphere-tracing", "--step", "2"],
        &["--method", "alpha", "--map-every", "4"],
        &["--method", "midpoint", "--intervals", "cones", "--entry", "constant"],
        &["--method", "midpoint", "--intervals", "ray-boxes", "--growth", "0.01"],
        &["--method", "alpha", "--intervals", "sample-boxes", "--map-every", "2"],
        &["--method", "midpoint", "--ray-steps", "128", "--shadow", "none"],
    ] {
        let (code, mean, message) = draw(options);
        assert_eq!(code, 0, "{message}");
        // Steps of one voxel of 48 along the tube, by a rule of order 1 at worst.
        assert!((mean.expect("a mean") - truth).abs() < 0.01, "{options:?}: {mean:?}, not {truth}");
    }
    for (options, said) in [
        (&["--growth", "0.1"][..], "--growth has no meaning for the method `gauss`"),
        (&["--method", "gauss", "--entry", "constant"], "--entry has no meaning for the method `gauss`"),
        (&["--map-every", "2"], "--map-every has no meaning for the method `gauss`"),
        (
            &["--method", "alpha", "--growth", "0.1", "--map-every", "2"],
            "--map-every needs steps of one length, and --growth makes them longer",
        ),
        (&["--intervals", "cones"], "--intervals has no meaning for the method `gauss`"),
        (&["--ray-steps", "8"], "--ray-steps has no meaning for the method `gauss`"),
        (&["--method", "alpha", "--ray-steps", "8", "--step", "2"], "--step has no meaning with --ray-steps"),
        (
            &["--method", "alpha", "--ray-steps", "8", "--entry", "cones"],
            "--entry has no meaning with --ray-steps",
        ),
        (
            &["--method", "alpha", "--intervals", "ray-boxes", "--entry", "constant"],
            "--entry has no meaning with boxes of --intervals",
        ),
        (&["--shadow", "none", "--shadow-step", "1"], "--shadow-step has no meaning with --shadow none"),
        (&["--method", "alpha", "--growth", "-1"], "expected a part from 0 to 1"),
        (&["--method", "simpson"], "invalid value 'simpson'"),
    ] {
        let (code, _, message) = draw(options);
        assert_eq!(code, 2, "{message}");
        assert!(message.contains(said), "{message}");
    }
    assert_eq!(folder.run(&["bake", "bent.toml", "-o", "bent.vdb"]).status.code(), Some(0));
    for option in [
        ["--growth", "0.1"],
        ["--entry", "cones"],
        ["--map-every", "1"],
        ["--intervals", "cones"],
        ["--ray-steps", "8"],
    ] {
        let output = folder.run(&[&["render", "bent.vdb", "-o", "a.png"], &option[..]].concat());
        assert_eq!(output.status.code(), Some(2));
        let message = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(message.contains(&format!("{} has no meaning for a file", option[0])), "{message}");
    }
    for (input, method, said) in [
        ("bent.vdb", "alpha", "--method alpha has no meaning for a file"),
        ("bent.toml", "planes", "--method planes has no meaning for a scene"),
        ("bent.toml", "cells", "--method cells has no meaning for a scene"),
    ] {
        let output = folder.run(&["render", input, "-o", "a.png", "--method", method]);
        assert_eq!(output.status.code(), Some(2));
        let message = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(message.contains(said), "{message}");
    }
    for method in ["planes", "cells"] {
        let output = folder.run(&[
            "render",
            "bent.vdb",
            "-o",
            &format!("{method}.exr"),
            "--size",
            "40x30",
            "--method",
            method,
        ]);
        assert_eq!(output.status.code(), Some(0));
    }
    let pictures =
        ["planes.exr", "cells.exr"].map(|name| std::fs::read(folder.path(name)).expect("a picture"));
    assert_ne!(pictures[0], pictures[1]);
}
