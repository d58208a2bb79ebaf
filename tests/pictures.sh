#!/usr/bin/env bash
# Makes the pictures of docs/rendering.md and README anew. Usage: tests/pictures.sh BINARIES REAL_DATA OUT
set -euo pipefail
bin=$1 data=$2 out=$3 docs=$(cd "$(dirname "$0")/../docs" && pwd)
mkdir -p "$out"

# A picture, of what, and options.
render() {
  local name=$1 volume=$2
  shift 2
  "$bin/voxrole-view" render "$out/$volume" -o "$out/$name.png" --size 300x300 "$@" >/dev/null 2>&1 ||
    { echo "$name.png was not drawn"; exit 1; }
}
tooth() {
  local name=$1
  shift
  render "$name" tooth.vxr --camera 30,10,1.3 "$@"
}

prepare() {
  local name=$1
  shift
  "$bin/voxrole" prepare "$@" -o "$out/$name.vxr" >/dev/null 2>&1
}
prepare tooth "$data/tooth/tooth.nhdr" --keep derivatives
prepare engine "$data/engine/engine.mhd"
prepare vismale "$data/vismale/vismale_128x256x256_u8.raw.gz" --dims 128,256,256 --dtype u8 --spacing 1.57774,0.995861,1.00797
"$bin/voxrole" phantom shells --dims 64,64,64 -o "$out/shells.nrrd" >/dev/null 2>&1

for field in value distance second-derivative role; do
  "$bin/voxrole" slice "$out/tooth.vxr" --field $field --axis y --index 47 -o "$out/slice-$field.png" >/dev/null
done
for kind in v-g v-f2 hit-hit; do
  "$bin/voxrole" histogram "$out/tooth.vxr" --kind $kind -o "$out/graph-$kind.png" >/dev/null
done
cp "$docs/rendering/painted-map.png" "$out"

pulp=84.44:862.6,119.1:171.3,F0E442 dentine=359.7:832,76.12:119.1,009E73
enamel=319.2:1270,171.3:224.1,56B4E9 enamel_on_dentine=832:1241,57.75:110.3,E69F00
tooth tooth-1 --alpha convex,1,4,3 --region $pulp,0.5
tooth tooth-2 --alpha convex,1,4,3 --region $dentine,0.5
tooth tooth-3 --alpha convex,1,4,3 --region $enamel,0.5
tooth tooth-4 --alpha convex,1,4,3 --region $enamel_on_dentine,0.9
tooth tooth-all --alpha convex,1,4,3 \
  --region $pulp,0.15 --region $dentine,0.23 --region $enamel,0.3 --region $enamel_on_dentine,0.9

whole=359.7:1270,57.75:224.1
number=1
for alpha in linear,0.1,15,1 convex,1,15,3 concave,1,15,3 concave,1,15,5 concave,1,15,7; do
  tooth alpha-$number --region $whole,E69F00,0.3 --alpha $alpha
  number=$((number + 1))
done

soft=ellipse,300:900,50:130,009E73 edges=polygon,700:60,1300:60,1300:260,900:230,E69F00,0.9
tooth regions --region $soft,0.3 --region $edges
tooth curve --curve "400,0060FF,0;600,00C0FF,0.1;900,FFC080,0.3;1200,FFFFFF,0.9"
tooth clip --region $soft,0.8 --region $edges --clip 30,10,0.1 --alpha convex,1,4,7
tooth painted --region "map:$out/painted-map.png,-0.5:1301.5,0:220,56B4E9,0.8" --region 359.7:832,76.12:119.1,E69F00,0.3 \
  --alpha convex,1,4,7 --clip 30,10,0.1

for strength in 0 1; do
  tooth occlusion-$strength --alpha convex,1,2,3 --region $whole,E69F00,0.9 --occlusion $strength
  render occlusion-engine-$strength engine.vxr --camera 30,30,1.6 --alpha convex,1,2,3 --region 60:255,40:140,B0B0B0,1 \
    --occlusion $strength
done
render scene tooth.vxr --camera 30,10,1 --region $whole,56B4E9,0.15 --alpha concave,1,3,5 --isosurface 1000,E69F00 \
  --bounding-box --axes --scale-bar

peaks="0.1,E69F00,0;0.14,E69F00,0.6;0.18,E69F00,0;0.6,56B4E9,0;0.64,56B4E9,0.9;0.68,56B4E9,0"
for integration in post pre pre-2d; do
  render value-$integration shells.nrrd --step 2 --classify value --curve "$peaks" --integration $integration
done
render value-engine engine.vxr --camera 30,20,1.2 --classify value \
  --curve "60,000000,0;90,60A0FF,0.02;140,60A0FF,0.02;150,000000,0;190,000000,0;210,FFC080,0.5;255,FFFFFF,0.6"

slices=(--technique slices --region $whole,E69F00,0.3)
tooth slices-16 "${slices[@]}" --step 16 --integration post
tooth slices-4 "${slices[@]}" --step 4 --integration post
tooth slices-4-pre "${slices[@]}" --step 4
tooth slices "${slices[@]}"
tooth slices-clip --technique slices --region $soft,0.8 --region $edges --alpha convex,1,4,7 --clip 60,30,0.1

"$bin/voxrole-view" bench "$out/tooth.vxr" -o "$out" --alpha concave,1,3,7 >/dev/null
"$bin/voxrole-view" render "$out/vismale.vxr" -o "$out/vismale.png" --size 640x640 --camera 40,10,1.3,180 >/dev/null 2>&1
