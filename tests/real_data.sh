#!/usr/bin/env bash
# Prepares, verifies, inspects and renders real volumes. Usage: tests/real_data.sh BINARIES REAL_DATA OUT
# Prints a table row per volume: dimensions, seconds, bytes, and whether the decoded voxels hash as they should.
set -euo pipefail
bin=$1 data=$2 out=$3
mkdir -p "$out"
# What `render` is told beyond its defaults: where to look from, and the boundaries to draw where those proposed by default
# hide what is inside.
declare -A view=(
  [cthead]="--camera 40,10,1.3,180"
  [vismale]="--camera 40,10,1.3,180"
  [ch2]="--camera 30,20,1.3 --region 88:136,4:21,E69F00,0.6 --region -32:33,5:48,56B4E9,0.03"
  [mr_gd]="--camera 30,20,1.3 --region 400:1600,200:740,E69F00,0.9 --region -210:324,5:711,009E73,0.04"
  [brain1]="--camera top,1.3 --alpha concave,1,3,5 --region 900:3000,300:1411,E69F00,0.5 --region -400:500,100:1411,56B4E9,0.02"
)

volume() {
  local name=$1 sha256=$2 axis=$3 index=$4 input=$5
  shift 5
  local file=$out/$name.vxr
  "$bin/voxrole" prepare "$data/$input" "$@" --keep derivatives --report "$out/$name.json" -o "$out/$name-full.vxr" >/dev/null 2>&1
  "$bin/voxrole" prepare "$data/$input" "$@" --report "$out/$name.json" -o "$file" >/dev/null 2>&1
  "$bin/voxrole" verify "$file" >/dev/null
  "$bin/voxrole" info "$file" --json > "$out/$name-info.json"
  for kind in v-g v-f2 v-hit hit-hit distance; do
    "$bin/voxrole" histogram "$file" --kind "$kind" -o "$out/$name-$kind.png"
  done
  for field in value distance second-derivative hit-gradient; do
    "$bin/voxrole" slice "$out/$name-full.vxr" --field "$field" --axis "$axis" --index "$index" -o "$out/$name-slice-$field.png"
  done
  local start=$SECONDS
  # shellcheck disable=SC2086 # the options are words
  "$bin/voxrole-view" render "$file" -o "$out/$name.png" --size 512x512 ${view[$name]:-} > "$out/$name-regions.txt" 2> "$out/$name-render.txt"
  python3 - "$name" "$sha256" "$out" "$((SECONDS - start))" <<'PY'
import json, sys
name, sha256, out, rendering = sys.argv[1:]
report, info = (json.load(open(f"{out}/{name}{end}.json")) for end in ("", "-info"))
dims = "×".join(map(str, report["dims"]))
voxels, size = report["counts"]["voxels"], report["file_bytes"]
share = 100 * report["counts"]["hits"] / voxels
hashed = "equal" if info["source"]["voxels_sha256"] == sha256 else "DIFFERENT"
print(f"| {name} | {dims} | {report['seconds']:.2f} | {size} | {size / voxels:.2f} | {share:.1f} % | {rendering} | {hashed} |")
if hashed != "equal":
    sys.exit(f"{name}: the decoded voxels are not those expected")
PY
}

echo "| volume | voxels | prepare, s | bytes | bytes per voxel | with a boundary | render 512², s | voxel hash |"
echo "|---|---|---|---|---|---|---|---|"
volume engine 6106d7cbb7dce6fa9395130cc706cf0a675d9bf11e98cefd749654a7842e5924 z 64 engine/engine.mhd
volume tooth 0149b5fa6dc38d5314bae74f2644b4f76b6da98129b0156a967960b450735a74 z 80 tooth/tooth.nhdr
volume cthead 8a378356d37fc55a977032375b1bd34298c0b137167dd0f05e025d66e0ae5d94 z 60 cthead/cthead_256x256x113_u16be.raw.gz \
  --dims 256,256,113 --dtype u16be --spacing 1,1,2
volume vismale 3aa9da2a3338259e6952834935b64f81aac567bd7635cdbb85a8e59647a395ed x 64 vismale/vismale_128x256x256_u8.raw.gz \
  --dims 128,256,256 --dtype u8 --spacing 1.57774,0.995861,1.00797
volume ch2 38e1383cfd10824abc62dd61c9597f83ff899c82e2a84eb37737bdc83bfc9d7d z 90 ch2/ch2.nii.gz
volume mr_gd 67c86a5785f62c204164bb9b68978edb8de931045d16ab517a1ad02b9fbd604f z 70 mr_gd/MR_Gd.nii.gz
volume brain1 cb06e37c791479070b5adbc2c5d69614acd43d39996405e98b55ec7ede0ecfad z 12 brain1/brain1_image.nrrd
volume walnut 83e5e0a9d0216620b73ed4ad00c2a43989cb53c2a0ae51019daaa4dd51945ce2 z 57 walnut/walnut.raw \
  --dims 128,96,114 --dtype u16
