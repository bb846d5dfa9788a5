//! Scenes with fewer octaves.

use crate::scene::{Pattern, Scene};

/// A scene with at most so many octaves in each layer; with none, without layers of noise.
pub fn with_octaves(scene: &Scene, most: u32) -> Scene {
    let mut scene = scene.clone();
    if most == 0 {
        for tube in &mut scene.tubes {
            tube.layers.retain(|layer| !matches!(layer.pattern, Pattern::Perlin(_)));
        }
    }
    for layer in scene.tubes.iter_mut().flat_map(|tube| &mut tube.layers) {
        if let Pattern::Perlin(noise) = &mut layer.pattern {
            noise.octaves = noise.octaves.min(most);
        }
    }
    scene
}

/// The most octaves of any layer.
pub fn most_octaves(scene: &Scene) -> u32 {
    let layers = scene.tubes.iter().flat_map(|tube| &tube.layers);
    let octaves = layers.map(|layer| match &layer.pattern {
        Pattern::Perlin(noise) => noise.octaves,
        Pattern::Constant(_) | Pattern::Sectors => 0,
    });
    octaves.max().unwrap_or(0)
}
