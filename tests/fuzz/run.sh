#!/usr/bin/env bash
# Fuzzes each target, or those named, and prints a table row for each. Usage: tests/fuzz/run.sh SECONDS [TARGET...]
# What is found is kept in tests/fuzz/corpus and tests/fuzz/artifacts; a crash, a hang or too much memory ends the run.
set -euo pipefail
seconds=$1
shift
cd "$(dirname "$0")"
read -ra targets <<< "${*:-$(cargo +nightly fuzz list --fuzz-dir . | tr '\n' ' ')}"

# No sanitizer: no reader has unsafe code, and without one there are several times as many runs. Arithmetic is checked.
cargo +nightly fuzz build --fuzz-dir . --sanitizer none
echo "| target | runs | runs a second | edges covered | corpus | peak memory, MB |"
echo "|---|---|---|---|---|---|"
for target in "${targets[@]}"; do
  mkdir -p "corpus/$target" "seeds/$target"
  case $target in
    packed_file) cp ../../crates/pack/tests/data/*.vxr "corpus/$target" ;;
    tiff) cp ../../crates/preprocess/tests/readers/data/*.tif "corpus/$target" ;;
    vti) cp ../../crates/preprocess/tests/readers/data/*.vti "corpus/$target" ;;
  esac
  log=$(mktemp)
  cargo +nightly fuzz run --fuzz-dir . --sanitizer none "$target" "corpus/$target" "seeds/$target" -- \
    -max_total_time="$seconds" -timeout=10 -rss_limit_mb=1024 -max_len=65536 -print_final_stats=1 > "$log" 2>&1 || {
    tail -60 "$log"
    exit 1
  }
  statistic() { sed -n "s/^stat::$1: *//p" "$log"; }
  covered=$(grep -o 'cov: [0-9]*' "$log" | tail -1 | cut -d' ' -f2)
  echo "| $target | $(statistic number_of_executed_units) | $(statistic average_exec_per_sec) | $covered |" \
    "$(find "corpus/$target" -type f | wc -l) | $(statistic peak_rss_mb) |"
  rm "$log"
done
