//! The page of `vdbake report`, in a browser.

use std::fs;
use std::sync::OnceLock;

use crate::cli::{Folder, errors};
use crate::oracle::judge;

/// A bent tube of two octaves, the same at every voxel size.
const SCENE: &str = "[bake]\nwiden = false\noctave_fade = false\n[[tube]]\nradius = 0.5\n\
    curve = { points = [[0, 0, -1], [0.4, 0, 0], [0, 0, 1]] }\n\
    [[tube.layer]]\nnoise = \"perlin\"\nfrequency = [1.5, 1.5, 1.5]\noctaves = 2\n\
    [[tube.layer]]\nop = \"add\"\nnoise = \"constant\"\nvalue = 1.0\n\
    [[light]]\nkind = \"sun\"\ndirection = [1, 1, -1]\n[medium]\nextinction = 5.0\n";

/// The scene and its report: made once for all tests.
fn folder() -> &'static Folder {
    static MADE: OnceLock<Folder> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = Folder::new();
        folder.put("scene.toml", SCENE);
        let quick = ["--resolution", "48", "--repeats", "1", "--size", "64x48", "--points", "5000"];
        // All plots' rows are made, however busy the machine is.
        let quick = [&quick[..], &["--time-limit", "200"]].concat();
        let output = folder.run(&[&["report", "scene.toml", "-o", "page.html"][..], &quick].concat());
        assert!(output.status.success(), "{}", errors(&output));
        folder
    })
}

#[test]
fn the_page_holds_all_it_shows() {
    let page = String::from_utf8(folder().get("page.html")).expect("UTF-8");
    assert!(page.starts_with("<!DOCTYPE html>") && !page.contains("<script") && !page.contains("@import"));
    for part in page.split("src=\"").skip(1) {
        assert!(part.starts_with("data:image/png;base64,"), "{}", &part[..40]);
    }
    let made = folder().made();
    for plot in ["time", "bytes", "convergence", "octaves", "pictures"] {
        let svg = String::from_utf8(folder().get(&format!("page-{plot}.svg"))).expect("UTF-8");
        assert!(svg.starts_with("<svg ") && svg.contains("<text"));
        let png = folder().get(&format!("page-{plot}.png"));
        // Width and height of the header.
        assert_eq!(png[16..24], [0, 0, 3, 192, 0, 0, 2, 208]);
    }
    // What is on a front has its command, which names the scene.
    assert!(page.contains("that no other beats in both") && page.contains("Orders of convergence"));
    assert!(page.contains("vdbake render scene.toml -o IMG") && !page.contains("vdbake bake SCENE"));
    assert!(made.iter().all(|name| name.starts_with("page") || name.starts_with("scene")), "{made:?}");
}

/// Finds the width of a page, how much wider what it holds is, and how many texts leave their plot.
const PROBE: &str = "\
    const look = (root) => { let out = 0;\
    for (const svg of root.querySelectorAll('svg')) { const box = svg.getBoundingClientRect();\
    for (const text of svg.querySelectorAll('text')) { const t = text.getBoundingClientRect();\
    if (t.left < box.left - 1 || t.right > box.right + 1 || t.top < box.top - 1 || t.bottom > box.bottom + 1) out++; } }\
    return [root.clientWidth, root.scrollWidth - root.clientWidth, out].join(' '); };\
    addEventListener('load', () => { const frame = document.querySelector('iframe');\
    const page = frame ? frame.contentDocument.documentElement : document.documentElement;\
    document.documentElement.dataset.found = look(page); });";

/// What the probe finds in a page, or in the frame that is in it, in a window of this size.
fn browse(page: &str, size: [u32; 2]) -> [f64; 3] {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("page.html");
    fs::write(&file, format!("{page}<script>{PROBE}</script>")).expect("a writable folder");
    let profile = folder.path().join("profile");
    let output = judge("VDBAKE_CHROMIUM")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args([
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--hide-scrollbars",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("--window-size={},{}", size[0], size[1]))
        .args(["--virtual-time-budget=2000", "--dump-dom"])
        .arg(format!("file://{}", file.display()))
        .output()
        .expect("a browser that starts");
    let dom = String::from_utf8_lossy(&output.stdout);
    let found = dom.split("data-found=\"").nth(1).and_then(|rest| rest.split('"').next());
    let found = found.unwrap_or_else(|| panic!("{dom:.2000}\n{}", String::from_utf8_lossy(&output.stderr)));
    let numbers: Vec<f64> = found.split(' ').map(|number| number.parse().expect("a number")).collect();
    numbers.try_into().expect("three")
}

#[test]
fn nothing_overflows_in_a_browser() {
    let page = String::from_utf8(folder().get("page.html")).expect("UTF-8");
    assert_eq!(browse(&page, [1280, 900]), [1280.0, 0.0, 0.0]);
    // As narrow as a telephone: a browser's window is not, a frame in it is.
    let inner = page.replace('&', "&amp;").replace('"', "&quot;");
    let style = "width:360px;height:800px;border:0";
    let frame = format!("<!DOCTYPE html><body><iframe style=\"{style}\" srcdoc=\"{inner}\"></iframe>");
    assert_eq!(browse(&frame, [800, 900]), [360.0, 0.0, 0.0]);
}

#[test]
fn a_scene_without_density_has_a_page() {
    let folder = Folder::new();
    folder.put("empty.toml", "");
    let output = folder.run(&["report", "empty.toml", "-o", "empty.html", "--quiet"]);
    assert!(output.status.success(), "{}", errors(&output));
    let page = String::from_utf8(folder.get("empty.html")).expect("UTF-8");
    assert_eq!(browse(&page, [1280, 900])[1], 0.0);
}
