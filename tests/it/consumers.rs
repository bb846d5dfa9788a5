//! Baked files in the programs that people load them into: the same values, at the right place and scale.

use std::fs;

use serde_json::{Value, json};
use tempfile::tempdir;

use crate::oracle::{Verdict, blender, openvdb, vdb_print, vdb_rs};
use crate::support::{Baked, FORMS, Voxel, assert_same, bake, rounded, scenes, scenes_with_tiles};

#[test]
fn openvdb_reads_what_was_evaluated() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        for form in FORMS {
            let context = format!("{} {form:?}", scene.display());
            let baked = bake(&scene, folder.path(), &form);
            let expected = rounded(&scene, baked.voxel_size, form);
            let verdict = openvdb(&baked.path).expect("OpenVDB reads the file");
            assert_same(&verdict.voxels, &expected, &context);
            assert_described(&verdict.report, &baked, &expected);
        }
    }
}

#[test]
fn vdb_print_finds_no_fault() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        for form in FORMS {
            let baked = bake(&scene, folder.path(), &form);
            let text = vdb_print(&baked.path).expect("vdb_print reads the file");
            for (label, key) in
                [("Number of active voxels", "active_voxels"), ("Number of active tiles", "tiles")]
            {
                assert_eq!(printed(&text, label), baked.report[key].as_u64(), "{key} of {}", scene.display());
            }
        }
    }
}

#[test]
fn vdb_rs_reads_what_was_evaluated() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        for form in FORMS {
            let baked = bake(&scene, folder.path(), &form);
            let context = format!("{} {form:?}", scene.display());
            assert_same(&vdb_rs(&baked.path, "density"), &rounded(&scene, baked.voxel_size, form), &context);
        }
    }
}

#[test]
fn blender_shows_what_was_evaluated_where_it_belongs() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        // Its OpenVDB reads every form of other files in these tests; here one of each precision and compression will do.
        for form in [FORMS[1], FORMS[2], FORMS[3]] {
            let baked = bake(&scene, folder.path(), &form);
            let expected = rounded(&scene, baked.voxel_size, form);
            let probes = probes(&expected);
            let points: Vec<_> =
                probes.iter().map(|probe| probe.0.map(|i| (f64::from(i) + 0.5) * baked.voxel_size)).collect();
            let Verdict { report, voxels } = blender(&baked.path, &points).expect("Blender loads the file");
            let context = format!("{} {form:?}", scene.display());
            assert_same(&voxels, &expected, &context);
            assert_described(&report["openvdb"], &baked, &expected);
            assert_eq!(report["grids"].as_array().map(Vec::len), Some(1), "{context}");
            assert_eq!(report["grids"][0]["name"], "density", "{context}");
            assert_eq!(report["grids"][0]["type"], "FLOAT", "{context}");
            assert_box(&report["world_box"], &expected, baked.voxel_size);
            assert_samples(&report["samples"]["density"], &probes, &context);
        }
    }
}

/// The judges can say no: none of them takes a file that lacks its last quarter.
#[test]
fn judges_refuse_a_truncated_file() {
    let folder = tempdir().expect("a temporary folder");
    let baked = bake(&scenes()[0], folder.path(), &[]);
    let bytes = fs::read(&baked.path).expect("a readable file");
    fs::write(&baked.path, &bytes[..bytes.len() * 3 / 4]).expect("a writable file");
    assert!(openvdb(&baked.path).is_err());
    assert!(vdb_print(&baked.path).is_err());
    assert!(blender(&baked.path, &[]).is_err());
}

/// That OpenVDB's description of a file fits what was baked, and what the program said of it.
fn assert_described(report: &Value, baked: &Baked, expected: &[Voxel]) {
    let h = baked.voxel_size;
    let grid = &report["grids"][0];
    assert_eq!(report["grids"].as_array().map(Vec::len), Some(1));
    assert_eq!(grid["name"], "density");
    assert_eq!(grid["type"], "float");
    assert_eq!(grid["class"], "fog volume");
    assert_eq!(grid["background"], 0.0);
    assert_eq!(grid["half"], baked.report["precision"] == "f16");
    assert_eq!(grid["map"], "UniformScaleTranslateMap");
    // The voxel with index (0, 0, 0) is the cell from 0 to h, and its sample the cell's centre.
    assert_eq!(grid["voxel_size"], json!([h, h, h]));
    assert_eq!(grid["origin"], json!([h / 2.0, h / 2.0, h / 2.0]));

    assert_eq!(grid["active_voxels"], expected.len());
    assert_eq!(grid["bbox"], json!(bounds(expected)));
    assert_eq!(grid["leaves"], baked.report["leaves"]);
    assert_eq!(baked.report["active_voxels"], expected.len());
    let length = fs::metadata(&baked.path).expect("a readable file").len();
    assert_eq!(baked.report["bytes"], length);
}

/// The lowest and highest index along each axis.
fn bounds(voxels: &[Voxel]) -> [[i32; 3]; 2] {
    let first = voxels[0].0;
    voxels.iter().fold([first, first], |[low, high], (index, _)| {
        [0, 1].map(|end| [0, 1, 2].map(|axis| [low[axis].min(index[axis]), high[axis].max(index[axis])][end]))
    })
}

/// Blender's box holds whole leaves, grown by half a voxel beyond their outermost samples.
fn assert_box(found: &Value, expected: &[Voxel], h: f64) {
    let [low, high] = bounds(expected);
    for axis in 0..3 {
        let low = f64::from(low[axis].div_euclid(8) * 8) * h;
        let high = f64::from(high[axis].div_euclid(8) * 8 + 8) * h;
        // Blender computes the corners in f32, from indices that are exact: a few roundings of the largest coordinate.
        let tolerance = 4.0 * f64::from(f32::EPSILON) * low.abs().max(high.abs());
        for (end, expected) in [low, high].into_iter().enumerate() {
            let found = found[end][axis].as_f64().expect("a number");
            assert!((found - expected).abs() <= tolerance, "axis {axis}: {found}, not {expected}");
        }
    }
}

/// Some active voxels, and inactive ones beside them.
fn probes(voxels: &[Voxel]) -> Vec<Voxel> {
    let step = voxels.len() / 500 + 1;
    let beside = |index: [i32; 3]| [index[0] + 1, index[1] - 1, index[2]];
    let picked = voxels.iter().step_by(step).flat_map(|voxel| [voxel.0, beside(voxel.0)]);
    picked
        .map(|index| {
            let value = voxels.binary_search_by_key(&index, |voxel| voxel.0).map_or(0.0, |at| voxels[at].1);
            (index, value)
        })
        .collect()
}

/// That Blender's trilinear values at the centres of voxels are the voxels' values.
fn assert_samples(found: &Value, expected: &[Voxel], context: &str) {
    let found: Vec<f64> = found.as_array().expect("a list").iter().filter_map(Value::as_f64).collect();
    assert_eq!(found.len(), expected.len(), "{context}");
    let largest = expected.iter().map(|voxel| voxel.1).fold(0.0, f32::max);
    for (found, (index, expected)) in found.into_iter().zip(expected) {
        // Blender's points and transform are f32. Four roundings (point, inverse scale, product, offset) move the point by
        // as many half units in the last place of its index, along three axes; a voxel away a value may differ by all.
        let furthest = index.iter().map(|i| i.unsigned_abs()).max().unwrap_or_default() + 1;
        let moved = 3.0 * 4.0 * f64::from(f32::EPSILON) / 2.0 * f64::from(furthest);
        let tolerance = moved * f64::from(largest);
        assert!(
            (found - f64::from(*expected)).abs() <= tolerance,
            "{context}: {found} at {index:?}, not {expected}"
        );
    }
}

/// The number after a label in the text of `vdb_print`, which sets commas between thousands.
fn printed(text: &str, label: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.trim().strip_prefix(label))?;
    line.trim_start_matches(':').trim().replace(',', "").parse().ok()
}
