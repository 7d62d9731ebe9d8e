#!/usr/bin/env bash
# The GPU tests and the GPU bench on a machine that has a GPU and this tree, but neither compiler nor network.
#
#   cargo test --release --workspace --no-run && cargo build --release --workspace --bin gradreel --bench gpu
#   bash benches/gpu.sh --pack [TARGET-FOLDER…]    # here: what is built, into .gpu/ [default: target]
#   bash benches/gpu.sh --run OUT [small]          # there, beside .gpu/: OUT/gpu.json, OUT/gpu.md, OUT/gpu.log
#
# Packing builds nothing: it takes the newest binaries. The weights that the binaries hold are cut out and put back from
# models/weights. A run takes at most eight minutes; each part has its own limit, and one that fails stops no other.
# `small` is for a software driver: smaller cases, no whole networks, no training. Exit code 1 says that a part failed, 2 that nothing could be run.
set -euo pipefail
export LC_ALL=C
cd "$(dirname "$0")/.."
tree=$PWD
bundle=$tree/.gpu
weights=models/weights/novel_view.safetensors
programs=(gpu gpu_limits scalar_wgsl cast physics gradreel_models)

fail() {
    echo "error: $*" >&2
    exit 2
}

# The newest binary whose tests (or whose help, of the bench) include the words of $2.
newest() {
    local name=$1 word=$2 file
    for file in $(for t in "${targets[@]}"; do ls "$t"/release/deps/"$name"-* 2>/dev/null; done |
        grep -E -- '-[0-9a-f]{16}$' | xargs -r ls -t); do
        if grep -qF -- "$word" "$file"; then
            echo "$file"
            return
        fi
    done
    fail "no built $name in ${targets[*]}; build it with the commands at the top of this file"
}

# Where the weights begin in a binary; nothing if they are not there.
place_of_weights() {
    perl -e 'undef $/; my ($all, $part) = map { open(my $f, "<:raw", $_) or die "$_: $!"; scalar <$f> } @ARGV;
        my $at = index($all, $part); print $at if $at >= 0' "$1" "$weights"
}

put() {
    local from=$1 name=$2 at
    objcopy --strip-all "$from" "$work/$name"
    (cd "$work" && sha256sum "$name") >>"$work/sums"
    at=$(place_of_weights "$work/$name")
    if [ -n "$at" ]; then
        head -c "$at" "$work/$name" >"$work/$name.head"
        tail -c +$((at + size + 1)) "$work/$name" >"$work/$name.tail"
        cat "$work/$name.head" "$weights" "$work/$name.tail" | cmp -s - "$work/$name" || fail "$name has other weights"
        rm "$work/$name"
    fi
}

pack() {
    targets=("$@")
    [ $# -gt 0 ] || targets=("${CARGO_TARGET_DIR:-target}")
    size=$(stat -c %s "$weights")
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    local name file words
    declare -A words=(
        [gpu]=every_kernel_agrees_with_the_cpu [gpu_limits]=dispatches_use_three_axes
        [scalar_wgsl]=emitted_functions_compute_the_same_on_a_gpu [cast]=every_half_widens_to_the_same_number
        [physics]=every_material_moves_as_on_the_cpu [gradreel_models]=a_gpu_takes_the_same_steps
    )
    for name in "${programs[@]}"; do
        file=$(newest "$name" "${words[$name]}")
        put "$file" "test-$name"
        # the tree that the tests were built in, where they look for their vectors
        grep -aoE '/[A-Za-z0-9_./+-]+/models/tests/vectors' "$file" | sed 's|/models/tests/vectors$||' >>"$work/trees" || true
    done
    put "$(newest gpu 'multiply-add f32')" bench
    file=$(for t in "${targets[@]}"; do ls -t "$t/release/gradreel" 2>/dev/null || true; done | xargs -r ls -t | head -1)
    [ -n "$file" ] || fail "no built gradreel in ${targets[*]}"
    put "$file" gradreel
    sort -u -o "$work/trees" "$work/trees"
    git rev-parse --short HEAD >"$work/commit" 2>/dev/null || echo unknown >"$work/commit"
    mkdir -p "$bundle"
    tar -C "$work" -cf - . | xz -9e --lzma2=preset=9e,dict=192MiB >"$bundle/gpu.tar.xz"
    echo "$bundle/gpu.tar.xz: $(($(stat -c %s "$bundle/gpu.tar.xz") / 1024)) KiB"
}

# Runs one part within its limit and what is left of the whole; its output goes to the log.
part() {
    local name=$1 limit=$2 left begin=$SECONDS code=0
    shift 2
    left=$((total - SECONDS))
    if [ "$left" -lt 5 ]; then
        printf 'part\t%s\tskipped\t0\ts\n' "$name" >>"$rows"
        : >"$scratch/part"
        return 0
    fi
    [ "$limit" -le "$left" ] || limit=$left
    printf '\n== %s\n' "$name" >>"$log"
    timeout -k 5 "$limit" "$@" >"$scratch/part" 2>&1 </dev/null || code=$?
    cat "$scratch/part" >>"$log"
    printf 'part\t%s\texit %s\t%s\ts\n' "$name" "$code" "$((SECONDS - begin))" >>"$rows"
    echo "$name: exit $code after $((SECONDS - begin)) s"
}

tests() {
    local name=$1 limit=$2
    shift 2
    part "tests of $name" "$limit" "$bin/test-$name" "$@"
    # where a test prints, its outcome stands on a line of its own
    awk -v file="$name" '
        /^test .* \.\.\. / { name = $2; outcome = $NF }
        /^(ok|FAILED)$/ { outcome = $1 }
        name != "" && (outcome == "ok" || outcome == "FAILED" || outcome == "ignored") {
            print "test\t" file " " name "\t" outcome "\t\t"; name = ""
        }
        { outcome = "" }' "$scratch/part" >>"$rows"
}

measure() {
    part "bench of $1" "$2" "$bin/bench" "$1" ${small:+small}
    awk -F'\t' 'NF == 4 { print "bench\t" $0 }' "$scratch/part" >>"$rows"
}

# Milliseconds of a training with so many steps.
trained() {
    local begin
    begin=$(date +%s%N)
    "$bin/gradreel" train novel-view --quiet --weights built-in --config "$scratch/train.toml" --device "$device" \
        --steps "$1" --out "$scratch/run-$1" >/dev/null || return 1
    echo $((($(date +%s%N) - begin) / 1000000))
}

steps() {
    local few=$1 many=$2 first second
    first=$(trained "$few") && second=$(trained "$many") || return 1
    awk -v a="$first" -v b="$second" -v n=$((many - few)) \
        'BEGIN { printf "train novel-view, %s samples\tpace\t%.2f\tsteps per second\n", ENVIRON["BATCH"], n * 1000 / (b - a) }'
}

as_json() {
    awk -F'\t' '
        function text(s) { gsub(/\\/, "\\\\", s); gsub(/"/, "\\\"", s); return "\"" s "\"" }
        BEGIN { print "[" }
        {
            value = $4 ~ /^-?[0-9]+(\.[0-9]+)?$/ ? $4 : text($4)
            printf "%s  {\"kind\": %s, \"name\": %s, \"what\": %s, \"value\": %s, \"unit\": %s}", (NR > 1 ? ",\n" : ""), text($1), text($2), text($3), value, text($5)
        }
        END { print "\n]" }' "$rows"
}

as_markdown() {
    awk -F'\t' '
        $1 == "machine" { machine = machine "| " $2 " | " $4 " |\n" }
        $1 == "test" { all++; if ($3 == "ok") good++; else bad = bad "- " $2 ": " $3 "\n" }
        $1 == "part" && $3 != "exit 0" { parts = parts "- " $2 ": " $3 " after " $4 " s\n" }
        $1 == "bench" { table = table "| " $2 " | " $3 " | " $4 " | " $5 " |\n" }
        END {
            print "| | |\n| --- | --- |\n" machine
            print "Tests: " good + 0 " of " all + 0 " agree with the CPU." (bad == "" ? "" : " These do not:\n\n" bad)
            if (parts != "") print "\nParts that failed or ran out of time:\n\n" parts
            print "\n| case | quantity | value | unit |\n| --- | --- | ---: | --- |\n" table
        }' "$rows"
}

run() {
    local out=$1
    small=${2:-}
    [ -f "$bundle/gpu.tar.xz" ] || fail "$bundle/gpu.tar.xz is not there; make it with --pack where the sources are built"
    mkdir -p "$out"
    out=$(cd "$out" && pwd)
    total=${GRADREEL_GPU_SECONDS:-470}
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    bin=$scratch/bin rows=$scratch/rows log=$out/gpu.log
    mkdir "$bin"
    : >"$rows"
    : >"$log"
    if command -v xz >/dev/null; then
        xz -dc "$bundle/gpu.tar.xz" | tar -C "$bin" -xf -
    else
        python3 -c 'import lzma, shutil, sys; shutil.copyfileobj(lzma.open(sys.argv[1]), sys.stdout.buffer)' \
            "$bundle/gpu.tar.xz" | tar -C "$bin" -xf -
    fi
    local head name built
    for head in "$bin"/*.head; do
        name=${head%.head}
        cat "$head" "$weights" "$name.tail" >"$name"
        chmod +x "$name"
    done
    (cd "$bin" && sha256sum --quiet -c sums) || fail "the weights of this tree are not those of the binaries"
    while read -r built; do
        [ -e "$built" ] || { mkdir -p "$(dirname "$built")" && ln -s "$tree" "$built"; }
        mkdir -p "$built/target/tmp"
    done <"$bin/trees"

    {
        printf 'machine\tcommit\t\t%s\t\n' "$(cat "$bin/commit")"
        printf 'machine\tprocessor\t\t%s, %s threads\t\n' "$(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1)" "$(nproc)"
        if command -v nvidia-smi >/dev/null; then
            printf 'machine\tcard and driver\t\t%s\t\n' \
                "$(nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader | head -1)"
        fi
    } >>"$rows"

    # what is measured is the GPU: a test without one fails
    export CI=true RUST_BACKTRACE=0
    tests scalar_wgsl 40
    tests gpu 60
    measure parity 40
    tests cast 20
    tests gpu_limits 30
    tests physics 60 gpu::
    if [ -n "$small" ]; then
        # a software driver takes minutes for whole networks
        tests gradreel_models 120 tests::layers:: networks::clip networks::autoencoder spatial_aware::attention weights::a_layer
    else
        tests gradreel_models 90 views::tests:: --skip mesh --skip objects:: --skip fullsize:: --skip keys:: --skip cameras::
    fi
    tests gradreel_models 60 field::tests:: --skip falling:: --skip claimed::
    for name in rates gemm conv2d conv3d attention; do measure "$name" 30; done
    measure "mpm 100k" 40
    measure "mpm 1M" 60
    measure unet 60
    local batches=(8 32)
    [ -z "$small" ] || batches=()
    [ -n "$small" ] || measure training 40
    export -f steps trained
    export bin scratch device=gpu
    for BATCH in "${batches[@]}"; do
        export BATCH
        printf '%s\n' '[optimiser]' 'at_once = 0' "batch = $BATCH" \
            '[validation]' 'every = 0' 'samples = 1' 'shapes = 1' 'steps = 1' >"$scratch/train.toml"
        rm -rf "$scratch"/run-*
        part "pace of training, $BATCH samples" 60 bash -c "steps 10 40"
        awk -F'\t' 'NF == 4 { print "bench\t" $0 }' "$scratch/part" >>"$rows"
    done

    awk -F'\t' '$1 == "bench" && $2 == "adapter" && $3 == "name" && !seen++ { print "machine\tadapter\t\t" $4 "\t" }' "$rows" >"$scratch/adapter"
    grep -v $'^bench\tadapter\t' "$rows" | cat "$scratch/adapter" - >"$scratch/sorted"
    rows=$scratch/sorted
    as_json >"$out/gpu.json"
    as_markdown >"$out/gpu.md"
    cat "$out/gpu.md"
    ! grep -qE $'^part\t[^\t]*\t(exit [1-9]|skipped)' "$rows"
}

case ${1:-} in
    --pack) pack "${@:2}" ;;
    --run) run "${2:?a folder for the results}" "${3:-}" ;;
    *) fail "--pack [TARGET-FOLDER…], or --run OUT [small]" ;;
esac
