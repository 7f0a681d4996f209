#include "experiments/bench/cases.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <span>

#include <palpate/accuracy.h>
#include <palpate/read_model.h>
#include <palpate/scene.h>
#include <palpate/trace.h>
#include "experiments/session/session.h"
#include "toolkit/core/hash.h"

namespace palpate::experiments {
namespace {

constexpr const char *kPublicSeed = "public", *kNominalSeed = "nominal", *kSecretSeed = "secret";
/// 64 bits as hexadecimal digits: too many to be tried.
constexpr std::size_t kLeastSecret = 16;

struct Size {
  int points, frames;  ///< at 1 kHz
};
/// A spacing of about a millimetre on a part; half a minute and some thirty touches of a hand.
constexpr Size kFullSize{51'000, 30'000}, kQuickSize{5'000, 1'500};

/// A way of scanning. Noise is in spacings: what matters is whether a hand's force tells the points apart.
struct Scanner {
  const char* name;
  double density;       ///< share of the points
  const char* of_part;  ///< options of sampling
};
constexpr Scanner kEven{"even", 1.0, "blue:noise=0"},
    kStructuredLight{"structured-light", 1.0, "blue:noise=0.05"},
    kHandHeld{"hand-held", 1.0, "blue:noise=0.15"}, kDepthCamera{"depth-camera", 0.4, "blue:noise=0.3"},
    kTurntable{"turntable", 1.0,
               "scan:views=8:noise=0.1:bias=0.1:dropout=0.02:flying=0.002:registration=0.1"};

struct PartDesign {
  const char* part;
  Scanner first, second;
};
constexpr std::array kPartDesigns = {
    PartDesign{"bent-comb", kEven, kHandHeld},       PartDesign{"ribs-and-bracket", kEven, kTurntable},
    PartDesign{"vase", kStructuredLight, kHandHeld}, PartDesign{"knotted-cable", kEven, kTurntable},
    PartDesign{"cog", kEven, kDepthCamera},          PartDesign{"leaning-fins", kEven, kStructuredLight}};

constexpr const char *kHand = "hand", *kWeave = "weave:depth_mm=1";

/// A shape with a formula, one of whose options is drawn. A formula of a height field goes on beyond its
/// points, where a hand would feel what no renderer can know: there the path weaves over the points.
struct FormulaDesign {
  const char* shape;
  const char* scanner;
  const char* options;
  const char* key;  ///< of the drawn dimension
  double nominal;
  double density;
  const char* path;
};
constexpr std::array kFormulaDesigns = {
    FormulaDesign{"relief", "raster", "finest_mm=5:mesh=false", "slope", 0.3, 1.0, kWeave},
    FormulaDesign{"relief", "raster-noisy", "finest_mm=5:noise=0.15", "slope", 0.3, 1.0, kWeave},
    FormulaDesign{"torus", "even", "sampling=blue", "tube", 0.35, 1.0, kHand},
    FormulaDesign{"torus", "hand-held", "sampling=random:noise=0.15", "tube", 0.35, 1.0, kHand},
    FormulaDesign{"pebble", "even", "sampling=blue", "slope", 0.2, 1.0, kHand},
    FormulaDesign{"pebble", "depth-camera", "sampling=random:noise=0.3", "slope", 0.2, 0.4, kHand}};

std::uint64_t hash_of(std::string_view text) {
  Hash64 hash;
  hash.bytes(std::as_bytes(std::span(text)));
  return hash.value();
}

/// Random numbers of one thing: those of another do not depend on how many it takes.
Random random_of(const BenchSeed& seed, const std::string& about) {
  return Random(mixed64(seed.number ^ hash_of(about)));
}

Dimensions drawn(const BenchSeed& seed, const std::string& shape) {
  return seed.name == kNominalSeed ? Dimensions() : Dimensions(random_of(seed, shape));
}

/// Of samplings, generators and hands, which take up to 1e18.
std::uint64_t small_seed(Random& random) {
  constexpr std::uint64_t kMost = 1'000'000'000;
  return random.below(kMost);
}

std::string path_of(const char* generator, int frames, Random& random) {
  return fmt::format("{}:frames={}:seed={}", generator, frames, small_seed(random));
}

}  // namespace

Result<BenchSeed> read_seed(const std::string& text) {
  const std::string seed = text.empty() ? kPublicSeed : text;
  const bool known = seed == kPublicSeed || seed == kNominalSeed;
  if (!known && seed.size() < kLeastSecret)
    return Error{fmt::format("a secret seed has at least {} characters", kLeastSecret),
                 "make one by `openssl rand -hex 16`, or leave --seed out for the public cases"};
  // The published hash must not give the numbers: they come from another one of the text.
  const std::string hashed = fmt::format("palpate-bench-{}:{}", kBenchVersion, seed);
  const std::string drawn_from = seed + hashed;
  BenchSeed read{known ? seed : kSecretSeed, sha256_of(std::as_bytes(std::span(hashed))), 0};
  const std::string digits = sha256_of(std::as_bytes(std::span(drawn_from)));
  constexpr int kHexadecimal = 16, kDigits = 16;
  std::from_chars(digits.data(), digits.data() + kDigits, read.number, kHexadecimal);
  return read;
}

std::vector<BenchCase> bench_cases(const BenchSeed& seed, bool quick) {
  const Size size = quick ? kQuickSize : kFullSize;
  const auto points = [&](double density) { return static_cast<int>(density * size.points); };
  std::vector<BenchCase> cases;
  for (const PartDesign& design : kPartDesigns) {
    const auto part = std::find_if(bench_parts().begin(), bench_parts().end(), [&](const BenchPart& p) {
      return std::string_view(p.name) == design.part;
    });
    for (const Scanner& scanner : {design.first, design.second}) {
      const std::string name = fmt::format("{}-{}", design.part, scanner.name);
      Random random = random_of(seed, name);
      const std::string sample =
          fmt::format("{}:points={}:seed={}", scanner.of_part, points(scanner.density), small_seed(random));
      cases.push_back(
          {name, design.part, &*part, drawn(seed, design.part), sample, path_of(kHand, size.frames, random)});
    }
  }
  for (const FormulaDesign& design : kFormulaDesigns) {
    const std::string name = fmt::format("{}-{}", design.shape, design.scanner);
    // Shape and sampling share a seed in generators: the cases of a shape have one.
    Dimensions dimensions = drawn(seed, design.shape);
    Random shape = random_of(seed, fmt::format("{} seed", design.shape)), random = random_of(seed, name);
    const std::string model = fmt::format("{}:extent_mm={}:points={}:{}:{}={:.9g}:seed={}", design.shape,
                                          kPartExtentMm, points(design.density), design.options, design.key,
                                          dimensions.length(design.nominal), small_seed(shape));
    cases.push_back(
        {name, design.shape, nullptr, dimensions, model, path_of(design.path, size.frames, random)});
  }
  return cases;
}

Result<Stage> bench_stage(const BenchCase& one, const OutputFolder& folder, int threads, Progress& progress) {
  StageRequest request;
  request.scene_name = one.name;
  if (one.part != nullptr) {
    PALPATE_ASSIGN(const OutputFolder truth, folder.inside("truth"));
    PALPATE_ASSIGN(const std::string file, truth.claim(one.name + ".ply"));
    PALPATE_TRY(io::write_mesh_ply(file, make_part(*one.part, one.drawn)));
    PALPATE_ASSIGN(request.scene,
                   scene::parse_scene(fmt::format("[[model]]\ncloud = \"truth/{}.ply\"\nunit = \"mm\"\n"
                                                  "sample = \"{}\"\n",
                                                  one.name, one.points),
                                      folder.file(one.name + ".toml").string()));
  } else {
    PALPATE_ASSIGN(request.scene, scene::open_scene(one.points));
  }
  request.path = one.path;
  request.threads = request.load.threads = threads;
  return set_up(request, all_readers(), progress);
}

CaseInputs inputs_of(const BenchCase& one, const Stage& stage) {
  return {one.name,
          one.shape,
          stage.scene.input.models.front().cloud->size(),
          stage.path.size(),
          stage.scene.provenance.front().content_hash,
          trace::path_hash(stage.path),
          stage.reference ? trace::trace_hash(metrics::as_trace(*stage.reference)) : std::string()};
}

}  // namespace palpate::experiments
