//! Where each phantom's boundaries lie.

use glam::DVec3;

use super::{
    BlurredBall, BlurredBox, Boundary, Junction, MarschnerLobb, Phantom, PhantomSettings, Scene, Shape, Surface,
};
use crate::{Error, Result};

/// A direction along no axis of the grid, of length 1.
const OBLIQUE: DVec3 = DVec3::new(0.8, 0.48, 0.36);

/// What the three balls' blurs were written for; another blur scales all three.
const THREE_BALLS_BLUR: f64 = 1.5;

/// A direction at right angles to [`OBLIQUE`], of length 1.
const ACROSS_OBLIQUE: DVec3 = DVec3::new(-0.6, 0.64, 0.48);

/// Distance between the slabs of the pair in blurs, at least: what one adds at the other is then below 1e-15 of its step.
const SLAB_GAP_IN_BLURS: f64 = 8.0;

/// Lengths of the world that a layout is made of.
struct Measures {
    /// Middle of the grid, moved off its symmetry by (0.3, −0.2, 0.1) of the smallest spacing, and by the offset.
    centre: DVec3,
    /// A 64th of the smallest extent.
    unit: f64,
    /// Blur in world units.
    blur: f64,
}

/// The scene of a phantom before scaling of its values; `settings` are valid.
///
/// # Errors
/// [`Error::Parameter`] for slabs too thick for the volume.
pub(super) fn scene(phantom: Phantom, settings: &PhantomSettings) -> Result<Scene> {
    let smallest_spacing = settings.geometry().smallest_spacing();
    let offset = smallest_spacing * DVec3::from_array(settings.offset);
    let extent = settings.extent();
    let measures = Measures {
        centre: settings.middle() + smallest_spacing * DVec3::new(0.3, -0.2, 0.1) + offset,
        unit: extent.min_element() / 64.0,
        blur: settings.blur * smallest_spacing,
    };
    Ok(match phantom {
        Phantom::Ball => ball(&measures),
        Phantom::Shells => shells(&measures),
        Phantom::Slabs => slabs(&measures),
        Phantom::ThreeBalls => three_balls(extent, offset, settings.blur / THREE_BALLS_BLUR * smallest_spacing),
        Phantom::Torus => torus(&measures),
        Phantom::BlurredBall => of_shape(blurred_ball(&measures)),
        Phantom::SlabPair => slab_pair(&measures, settings.thickness * smallest_spacing, settings)?,
        Phantom::Box => of_shape(blurred_box(&measures)),
        Phantom::Junction => of_shape(junction(&measures)),
        Phantom::MarschnerLobb => of_shape(Shape::MarschnerLobb(MarschnerLobb {
            centre: measures.centre,
            half_edge: 32.0 * measures.unit,
            step: 1.0,
        })),
    })
}

/// A scene from 0 to 1 of boundaries.
fn of_boundaries(boundaries: Vec<Boundary>) -> Scene {
    Scene { low: 0.0, value_range: [0.0, 1.0], boundaries, shapes: vec![] }
}

/// A scene from 0 to 1 of one shape.
fn of_shape(shape: Shape) -> Scene {
    Scene { low: 0.0, value_range: [0.0, 1.0], boundaries: vec![], shapes: vec![shape] }
}

fn ball(measures: &Measures) -> Scene {
    let surface = Surface::Ball { centre: measures.centre, radius: 20.0 * measures.unit };
    of_boundaries(vec![Boundary { surface, step: 1.0, blur: measures.blur }])
}

fn shells(measures: &Measures) -> Scene {
    let boundary = |radius: f64, step| Boundary {
        surface: Surface::Ball { centre: measures.centre, radius: radius * measures.unit },
        step,
        blur: measures.blur,
    };
    of_boundaries(vec![boundary(26.0, 0.3), boundary(12.0, 0.7)])
}

fn slabs(measures: &Measures) -> Scene {
    let plane = |offset: f64, step| oblique_plane(measures, offset * measures.unit, step);
    of_boundaries(vec![plane(-20.0, 1.0), plane(-8.0, -1.0), plane(6.0, 0.6), plane(10.0, -0.6)])
}

/// A plane `offset` world units along [`OBLIQUE`] from the centre.
fn oblique_plane(measures: &Measures, offset: f64, step: f64) -> Boundary {
    let surface = Surface::HalfSpace { normal: OBLIQUE, offset: OBLIQUE.dot(measures.centre) + offset };
    Boundary { surface, step, blur: measures.blur }
}

/// Three balls given in voxels of a volume of 256³: the two small ones lie inside the large one, apart.
fn three_balls(extent: DVec3, offset: DVec3, blur_unit: f64) -> Scene {
    let unit = extent.min_element() / 256.0;
    let corner = 0.5 * (extent - extent.min_element()) + offset;
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
        shapes: vec![],
    }
}

fn torus(measures: &Measures) -> Scene {
    let surface = Surface::Torus {
        centre: measures.centre,
        axis: OBLIQUE,
        major_radius: 18.0 * measures.unit,
        minor_radius: 8.0 * measures.unit,
    };
    of_boundaries(vec![Boundary { surface, step: 1.0, blur: measures.blur }])
}

fn blurred_ball(measures: &Measures) -> Shape {
    Shape::Ball(BlurredBall { centre: measures.centre, radius: 20.0 * measures.unit, step: 1.0, blur: measures.blur })
}

fn slab_pair(measures: &Measures, thickness: f64, settings: &PhantomSettings) -> Result<Scene> {
    let gap = (16.0 * measures.unit).max(SLAB_GAP_IN_BLURS * measures.blur);
    let outermost = 0.5 * gap + thickness;
    if outermost > 30.0 * measures.unit {
        return Err(Error::Parameter(format!(
            "two slabs {} voxels thick with a blur of {} do not fit apart into {:?} voxels: make them thinner or the \
             volume larger",
            settings.thickness, settings.blur, settings.dims
        )));
    }
    let plane = |offset: f64, step| oblique_plane(measures, offset, step);
    Ok(of_boundaries(vec![
        plane(-outermost, 1.0),
        plane(-0.5 * gap, -1.0),
        plane(0.5 * gap, 0.6),
        plane(outermost, -0.6),
    ]))
}

fn blurred_box(measures: &Measures) -> Shape {
    Shape::Box(BlurredBox {
        centre: measures.centre,
        half_extents: measures.unit * DVec3::new(18.0, 15.0, 12.0),
        step: 1.0,
        blur: measures.blur,
    })
}

fn junction(measures: &Measures) -> Shape {
    Shape::Junction(Junction {
        centre: measures.centre,
        normal: OBLIQUE,
        split_normal: ACROSS_OBLIQUE,
        step: 0.4,
        split: 0.6,
        blur: measures.blur,
    })
}
