//! Where each phantom's boundaries lie.

use glam::DVec3;

use super::{Boundary, Phantom, PhantomSettings, Scene, Surface};

/// A direction along no axis of the grid, of length 1.
const OBLIQUE: DVec3 = DVec3::new(0.8, 0.48, 0.36);

/// What the three balls' blurs were written for; another blur scales all three.
const THREE_BALLS_BLUR: f64 = 1.5;

/// Lengths of the world that a layout is made of.
struct Measures {
    /// Middle of the grid, moved off its symmetry by (0.3, −0.2, 0.1) of the smallest spacing.
    centre: DVec3,
    /// A 64th of the smallest extent.
    unit: f64,
    /// Blur in world units.
    blur: f64,
}

/// The scene of a phantom; `settings` are valid.
pub(super) fn scene(phantom: Phantom, settings: &PhantomSettings) -> Scene {
    let geometry = settings.geometry();
    let smallest_spacing = geometry.smallest_spacing();
    let spacing = DVec3::from_array(settings.spacing);
    let dims = DVec3::from_array(settings.dims.map(f64::from));
    let measures = Measures {
        centre: 0.5 * (dims - 1.0) * spacing + smallest_spacing * DVec3::new(0.3, -0.2, 0.1),
        unit: (dims * spacing).min_element() / 64.0,
        blur: settings.blur * smallest_spacing,
    };
    match phantom {
        Phantom::Ball => ball(&measures),
        Phantom::Shells => shells(&measures),
        Phantom::Slabs => slabs(&measures),
        Phantom::ThreeBalls => three_balls(dims * spacing, settings.blur / THREE_BALLS_BLUR * smallest_spacing),
        Phantom::Torus => torus(&measures),
    }
}

fn ball(measures: &Measures) -> Scene {
    let surface = Surface::Ball { centre: measures.centre, radius: 20.0 * measures.unit };
    Scene { low: 0.0, value_range: [0.0, 1.0], boundaries: vec![Boundary { surface, step: 1.0, blur: measures.blur }] }
}

fn shells(measures: &Measures) -> Scene {
    let boundary = |radius: f64, step| Boundary {
        surface: Surface::Ball { centre: measures.centre, radius: radius * measures.unit },
        step,
        blur: measures.blur,
    };
    Scene { low: 0.0, value_range: [0.0, 1.0], boundaries: vec![boundary(26.0, 0.3), boundary(12.0, 0.7)] }
}

fn slabs(measures: &Measures) -> Scene {
    let plane = |offset: f64, step| Boundary {
        surface: Surface::HalfSpace { normal: OBLIQUE, offset: OBLIQUE.dot(measures.centre) + offset * measures.unit },
        step,
        blur: measures.blur,
    };
    Scene {
        low: 0.0,
        value_range: [0.0, 1.0],
        boundaries: vec![plane(-20.0, 1.0), plane(-8.0, -1.0), plane(6.0, 0.6), plane(10.0, -0.6)],
    }
}

/// Three balls given in voxels of a volume of 256³: the two small ones lie inside the large one, apart.
fn three_balls(extent: DVec3, blur_unit: f64) -> Scene {
    let unit = extent.min_element() / 256.0;
    let corner = 0.5 * (extent - extent.min_element());
    let ball = |centre: [f64; 3], radius: f64, step, blur: f64| Boundary {
        surface: Surface::Ball { centre: corner + unit * DVec3::from_array(centre), radius: radius * unit },
        step,
        blur: blur * blur_unit,
    };
    Scene {
        low: 0.0,
        value_range: [0.0, 0.8],
        boundaries: vec![
            ball([128.3, 127.8, 128.1], 80.0, 0.5, 1.0),
            ball([90.0, 120.0, 130.0], 25.0, 0.3, 1.5),
            ball([160.0, 140.0, 120.0], 30.0, -0.2, 1.2),
        ],
    }
}

fn torus(measures: &Measures) -> Scene {
    let surface = Surface::Torus {
        centre: measures.centre,
        axis: OBLIQUE,
        major_radius: 18.0 * measures.unit,
        minor_radius: 8.0 * measures.unit,
    };
    Scene { low: 0.0, value_range: [0.0, 1.0], boundaries: vec![Boundary { surface, step: 1.0, blur: measures.blur }] }
}
