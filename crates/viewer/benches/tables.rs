//! What a knob costs before the next picture: tables and skipping, rebuilt for a transfer function.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};
use voxrole_viewer::classify::{
    Drawn, EmphasisTable, MacrocellRanges, MacrocellSamples, Occlusion, Occupancy, OpacityTable, PreintegrationTable,
    ValueTable,
};
use voxrole_viewer::frame::Frame;
use voxrole_viewer::reference::roles::Roles;
use voxrole_viewer::state::{Curve, PaintedMap, Region, Shape, TransferFunction};
use voxrole_viewer::{ViewState, VolumeDescription, VolumeTexels};

const SIDE: u32 = 256;

/// Concentric shells, ten voxels apart.
fn volume() -> VolumeTexels {
    let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
    let geometry = GridGeometry::axis_aligned([SIDE; 3], [1.0; 3]);
    let description = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
    let middle = 0.5 * (SIDE - 1) as f32;
    let side = SIDE as usize;
    let texels = (0..side.pow(3)).map(|index| {
        let place = [index % side, index / side % side, index / (side * side)];
        let radius = place.map(|place| (place as f32 - middle).powi(2)).iter().sum::<f32>().sqrt();
        let (shell, distance) = ((radius / 10.0).round(), radius - 10.0 * (radius / 10.0).round());
        let gradient = 1 + (shell as u16 * 2654) % 65534;
        [(radius * 250.0) as u16, (distance / 15.0 * 32766.0) as i16 as u16, gradient, 0]
    });
    VolumeTexels { description, texels: texels.collect() }
}

fn transfer_function() -> TransferFunction {
    let regions = [
        "0.1:0.4,0.1:0.3,E69F00,0.3",
        "ellipse,0.3:0.9,0.2:0.6,009E73,0.3@concave,1,3,5",
        "polygon,0.5:0.1,0.9:0.1,0.9:0.5,0.7:0.9,56B4E9,0.9",
        "triangle,0.1:0.5,0.5:0.9,D55E00,0.5@linear,0.1,15,1/concave,1,3,7",
    ];
    let regions = regions.map(|region| region.parse().expect("a region")).to_vec();
    TransferFunction { regions, ..TransferFunction::default() }
}

fn tables(criterion: &mut Criterion) {
    let (volume, transfer_function) = (volume(), transfer_function());
    let VolumeDescription { value_range, hit_gradient, .. } = volume.description;
    let opacities = || OpacityTable::new(black_box(&transfer_function), value_range, hit_gradient);
    let (table, emphases) = (opacities(), EmphasisTable::new(&transfer_function));
    let state = ViewState { transfer_function: transfer_function.clone(), ..ViewState::default() };
    let frame = Frame::new(&state, &volume.description, &emphases, [512; 2]);
    let ranges = MacrocellRanges::new(&volume);
    let mut group = criterion.benchmark_group("tables");
    group.bench_function("opacity by value and gradient, four regions", |bencher| bencher.iter(opacities));
    let painted = transfer_function
        .regions
        .iter()
        .map(|region| Region { shape: Shape::Painted(region.shape.painted(region.softness)), ..region.clone() });
    let painted = TransferFunction { regions: painted.collect(), ..TransferFunction::default() };
    group.bench_function("opacity by value and gradient, the same four painted", |bencher| {
        bencher.iter(|| OpacityTable::new(black_box(&painted), value_range, hit_gradient));
    });
    let mut map = PaintedMap::blank();
    map.stroke([0.1, 0.2], [0.5, 0.7], [0.1; 2], false);
    map.stroke([0.5, 0.7], [0.9, 0.7], [0.1; 2], false);
    let everywhere = Region {
        shape: Shape::Painted(map),
        value: [0.0, 1.0],
        gradient: [0.0, 1.0],
        ..transfer_function.regions[0].clone()
    };
    let everywhere = TransferFunction { regions: vec![everywhere], ..TransferFunction::default() };
    group.bench_function("opacity by value and gradient, a stroke over everything", |bencher| {
        bencher.iter(|| OpacityTable::new(black_box(&everywhere), value_range, hit_gradient));
    });
    group.bench_function("opacity by distance, three of them", |bencher| {
        bencher.iter(|| EmphasisTable::new(black_box(&transfer_function)));
    });
    group.bench_function("its integrals", |bencher| bencher.iter(|| PreintegrationTable::new(black_box(&emphases))));
    group.bench_function("occupancy of 256³", |bencher| {
        bencher.iter(|| Occupancy::new(black_box(&ranges), &table, &frame));
    });
    let samples = MacrocellSamples::new(&volume);
    let occupancy = Occupancy::new(&ranges, &table, &frame);
    let drawn = Drawn { volume: &volume.description, planes: &[], occupancy: Some(&occupancy) };
    group.bench_function("occlusion of 256³", |bencher| {
        bencher.iter(|| Occlusion::of_roles(black_box(&samples), drawn, &table, &emphases));
    });
    group.bench_function("roles of the CPU", |bencher| {
        bencher.iter(|| Roles::new(black_box(&table), &transfer_function));
    });
    let curve: Curve = "0.1,FF6262,0;0.5,FFFFB4,0.9;0.75,FFFFFF,0.2;1,FFFFFF,0".parse().expect("a curve");
    for (name, step) in [("value alone, one axis", None), ("value alone, two axes", Some(1.0))] {
        group.bench_function(name, |bencher| bencher.iter(|| ValueTable::new(black_box(&curve), value_range, step)));
    }
    group.finish();
}

criterion_group!(benches, tables);
criterion_main!(benches);
