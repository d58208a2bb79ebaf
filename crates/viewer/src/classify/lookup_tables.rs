//! All that a state makes of a volume, for the CPU and the GPU: tables that are made anew only when what they are made of
//! changes.

use glam::Vec4;

use super::{Drawn, EmphasisTable, MacrocellRanges, MacrocellSamples, Occlusion, Occupancy, OpacityTable, ValueTable};
use crate::frame::Frame;
use crate::state::{Classification, Curve, TransferFunction, TwoSidedEmphasis, ViewState};
use crate::volume::VolumeDescription;

/// What has been made, and of what.
struct Made<K, T>(Option<(K, T)>);

impl<K: PartialEq, T> Made<K, T> {
    const NOTHING: Self = Self(None);

    /// Makes it of `key`, unless it is there; whether that was done.
    fn update(&mut self, key: K, make: impl FnOnce(&K) -> T) -> bool {
        if self.0.as_ref().is_some_and(|(of, _)| *of == key) {
            return false;
        }
        let made = make(&key);
        self.0 = Some((key, made));
        true
    }

    fn get(&self) -> Option<&T> {
        self.0.as_ref().map(|(_, made)| made)
    }
}

/// Where occupancy comes from, beside the opacity table: how far boundaries and steps reach, whether rays leap at all and
/// the order within steps counts, and what decides.
type OccupancyKey = ([f32; 2], [bool; 2], Classification);

/// The tables of one volume.
pub struct LookupTables {
    volume: VolumeDescription,
    ranges: MacrocellRanges,
    samples: Option<MacrocellSamples>,
    emphases: Made<TransferFunction, EmphasisTable>,
    opacity: Made<TransferFunction, OpacityTable>,
    /// Of a curve, and of the step where the order within it counts.
    values: Made<(Curve, Option<f32>), ValueTable>,
    occupancy: Made<OccupancyKey, Option<Occupancy>>,
    /// Of what is drawn, and what cuts it.
    occlusion: Made<Option<(TransferFunction, Vec<Vec4>)>, Option<Occlusion>>,
}

/// Which tables are others than before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Changes {
    /// Opacity and colour by value and gradient magnitude.
    pub opacity: bool,
    /// What value alone decides.
    pub values: bool,
    /// Where something can be drawn.
    pub occupancy: bool,
    /// How little light comes where.
    pub occlusion: bool,
}

impl LookupTables {
    /// Those of a volume whose macrocells hold `ranges`.
    #[must_use]
    pub fn new(volume: &VolumeDescription, ranges: MacrocellRanges) -> Self {
        Self {
            volume: volume.clone(),
            ranges,
            samples: None,
            emphases: Made::NOTHING,
            opacity: Made::NOTHING,
            values: Made::NOTHING,
            occupancy: Made::NOTHING,
            occlusion: Made::NOTHING,
        }
    }

    /// Whether there is what occlusion is worked out from.
    #[must_use]
    pub fn has_samples(&self) -> bool {
        self.samples.is_some()
    }

    /// Takes what occlusion is worked out from, of the same volume. Until then light comes everywhere.
    pub fn set_samples(&mut self, samples: MacrocellSamples) {
        self.samples = Some(samples);
    }

    /// Forgets them: they are not needed, and can be gathered again.
    pub fn drop_samples(&mut self) {
        self.samples = None;
    }

    /// Brings the tables up to date with a state; returns the numbers of its picture of `image_size` pixels, and what of
    /// the tables has changed.
    pub fn update(&mut self, state: &ViewState, image_size: [u32; 2]) -> (Frame, Changes) {
        let transfer_function = &state.transfer_function;
        self.emphases.update(transfer_function.clone(), EmphasisTable::new);
        let frame = Frame::new(state, &self.volume, self.emphases(), image_size);
        // The αd that regions share is none of its business.
        let without = TransferFunction { emphasis: TwoSidedEmphasis::default(), ..transfer_function.clone() };
        let VolumeDescription { value_range, hit_gradient, .. } = self.volume;
        let opacity = self.opacity.update(without, |of| OpacityTable::new(of, value_range, hit_gradient));
        let is_by_value = frame.classification == Classification::Value;
        let of = (transfer_function.curve.clone(), frame.is_ordered.then_some(frame.step));
        let values = is_by_value && self.values.update(of, |_| ValueTable::of(state, &self.volume, &frame));
        let occupancy = self.update_occupancy(state, &frame, opacity);
        let occlusion = self.update_occlusion(state, &frame);
        (frame, Changes { opacity, values, occupancy, occlusion })
    }

    /// αd of all emphases.
    ///
    /// # Panics
    /// Before the first [`Self::update`], as the others.
    #[must_use]
    pub fn emphases(&self) -> &EmphasisTable {
        self.emphases.get().expect("is updated first")
    }

    /// Opacity and colour by value and gradient magnitude.
    #[must_use]
    pub fn opacity(&self) -> &OpacityTable {
        self.opacity.get().expect("is updated first")
    }

    /// What value alone decides; that of the last state of which it did.
    #[must_use]
    pub fn values(&self) -> Option<&ValueTable> {
        self.values.get()
    }

    /// Where something can be drawn; `None` where rays do not leap.
    #[must_use]
    #[inline(always)]
    pub fn occupancy(&self) -> Option<&Occupancy> {
        self.occupancy.get().and_then(Option::as_ref)
    }

    /// How little light comes where; `None` where it comes everywhere.
    #[must_use]
    #[inline(always)]
    pub fn occlusion(&self) -> Option<&Occlusion> {
        self.occlusion.get().and_then(Option::as_ref)
    }

    /// Macrocells along x, y, z.
    #[must_use]
    pub fn macrocells(&self) -> [usize; 3] {
        self.ranges.dims()
    }

    fn update_occupancy(&mut self, state: &ViewState, frame: &Frame, is_outdated: bool) -> bool {
        if is_outdated {
            self.occupancy = Made::NOTHING;
        }
        let Self { ranges, opacity, values, .. } = self;
        let leaps = state.render_settings.leaps;
        let key = ([frame.reach, frame.half_step], [leaps, frame.is_ordered], frame.classification);
        self.occupancy.update(key, |_| {
            let opacity = opacity.get().filter(|_| leaps)?;
            Some(match (frame.classification, values.get()) {
                (Classification::Stored, _) => Occupancy::of_values(ranges, |[_, high]| high > 0, frame),
                (Classification::Value, Some(values)) => Occupancy::of_values(ranges, |range| values.any(range), frame),
                _ => Occupancy::new(ranges, opacity, frame),
            })
        })
    }

    fn update_occlusion(&mut self, state: &ViewState, frame: &Frame) -> bool {
        let Self { volume, samples, emphases, opacity, values, occupancy, .. } = self;
        let planes = frame.cutting_planes();
        let samples = samples.as_ref().filter(|_| frame.shading.occlusion > 0.0);
        let of = samples.map(|_| (state.transfer_function.clone(), planes.to_vec()));
        self.occlusion.update(of, |_| {
            let occupancy = occupancy.get().and_then(Option::as_ref);
            let (samples, drawn) = (samples?, Drawn { volume, planes, occupancy });
            Some(match (frame.classification, values.get()) {
                (Classification::Stored, _) => Occlusion::of_stored(samples, drawn),
                (Classification::Value, Some(values)) => Occlusion::of_values(samples, drawn, values),
                _ => Occlusion::of_roles(samples, drawn, opacity.get()?, emphases.get()?),
            })
        })
    }
}
