#include "experiments/benchmarks/felt_surface/ground.h"

#include <fmt/format.h>

#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate::felt {
namespace {

/// `points` and `quick_points` replace the @ of "points=@".
DataSet generated(std::string name, std::string about, const std::string& text, const std::string& points,
                  const std::string& quick_points, Stroke stroke = Stroke::kWeave) {
  const std::size_t at = text.find('@');
  const auto with = [&](const std::string& count) {
    return text.substr(0, at) + count + text.substr(at + 1) + ":mesh=false";
  };
  return {std::move(name), std::move(about), with(points), with(quick_points), stroke, false, 0.0, {}};
}

std::vector<DataSet> round_sets() {
  return {
      generated("ell", "ellipsoid", "ellipsoid:points=@", "400000", "60000"),
      generated("rbox", "block with edges of 2 mm radius", "rounded-box:points=@", "225000", "60000"),
      generated("shell", "two spheres 0.6 mm apart", "shells:extent_mm=32:gap_mm=0.6:points=@", "160000",
                "60000"),
      generated("bowl", "open bowl", "bowl:points=@", "70000", "40000"),
      generated("blue", "torus, blue noise", "torus:sampling=blue:points=@", "428860", "60000"),
      generated("trand", "torus, at random", "torus:sampling=random:points=@", "428860", "60000"),
      generated("tnoise", "torus, at random, noise .22", "torus:sampling=random:noise=0.22:points=@",
                "428860", "60000"),
      generated("tn05", "torus, noise .05", "torus:sampling=blue:noise=0.05:points=@", "200000", "60000"),
      generated("tn10", "torus, noise .10", "torus:sampling=blue:noise=0.1:points=@", "200000", "60000"),
      generated("tn15", "torus, noise .15", "torus:sampling=blue:noise=0.15:points=@", "200000", "60000"),
      generated("tn30", "torus, noise .30", "torus:sampling=blue:noise=0.3:points=@", "200000", "60000"),
      generated("tn50", "torus, noise .50", "torus:sampling=blue:noise=0.5:points=@", "200000", "60000"),
      generated("near", "torus, noise .15, 1 % outliers near",
                "torus:sampling=blue:noise=0.15:outliers=0.01:points=@", "200000", "60000"),
      generated("box", "torus, noise .15, 1 % outliers in the box",
                "torus:sampling=blue:noise=0.15:outliers=0.01:outliers_at=box:points=@", "200000", "60000"),
      generated("c20k", "torus, coarse", "torus:sampling=blue:points=@", "20000", "20000"),
      generated("c5k", "torus, coarser", "torus:sampling=blue:points=@", "5000", "5000"),
      generated("c20kn", "torus, coarse, noise .15", "torus:sampling=blue:noise=0.15:points=@", "20000",
                "20000"),
      generated("rboxn15", "block, noise .15", "rounded-box:noise=0.15:points=@", "225000", "60000"),
      generated("rboxn30", "block, noise .30", "rounded-box:noise=0.3:points=@", "225000", "60000"),
      // Gaps of 1.5 and 1.0 spacings: the spacing is sqrt(2 x 4 pi r^2 / points).
      generated("thin15", "thin shells, gap of 1.5 spacings", "shells:extent_mm=32:gap_mm=0.3:points=@",
                "160000", "160000"),
      generated("thin10", "thin shells, gap of 1 spacing", "shells:extent_mm=32:gap_mm=0.2:points=@",
                "160000", "160000"),
      generated("mouth", "ball with a mouth: pressed, slid into, to the middle",
                "bowl:rim_deg=150:felt=outside:points=@", "160000", "60000", Stroke::kMouth),
  };
}

std::vector<DataSet> height_field_sets() {
  return {
      generated("roof", "roof of 90 degrees", "wedge:extent_mm=60:sampling=blue:points=@", "160000", "60000",
                Stroke::kRidge),
      generated("roof10", "roof, noise .1", "wedge:extent_mm=60:sampling=blue:noise=0.1:points=@", "160000",
                "60000", Stroke::kRidge),
      generated("roof20", "roof, noise .2", "wedge:extent_mm=60:sampling=blue:noise=0.2:points=@", "160000",
                "60000", Stroke::kRidge),
      generated("corner", "floor that meets a wall",
                "wedge:angle_deg=270:extent_mm=60:sampling=blue:points=@", "160000", "60000"),
      generated("sin24k", "sinusoid", "sinusoid:points=@", "24025", "24025"),
      generated("sin1m", "sinusoid, shuffled", "sinusoid:shuffle:points=@", "1002001", "60025"),
      generated("sinn", "sinusoid, noise .15", "sinusoid:noise=0.15:points=@", "1002001", "60025"),
      generated("lines", "sinusoid, scan lines 8:1", "sinusoid:sampling=lines:points=@", "200000", "60000"),
      generated("step", "sinusoid, density step 16:1", "sinusoid:sampling=blue:density=16:points=@", "200000",
                "60000"),
      generated("border", "0.6 mm beside the border of a sheet, 0.2 mm deep",
                "plane:extent_mm=20:sampling=blue:points=@", "441", "441", Stroke::kBorder),
  };
}

std::vector<DataSet> all_sets() {
  std::vector<DataSet> all = round_sets();
  for (DataSet& set : height_field_sets()) all.push_back(std::move(set));
  all.push_back({"cross",
                 "two sheets at random that cross, pressed into their corner",
                 "1",
                 "1",
                 Stroke::kCorner,
                 false,
                 0.0,
                 {}});
  all.push_back({"tee",
                 "a wall at random that stands on a floor, pressed into the corner",
                 "0",
                 "0",
                 Stroke::kCorner,
                 false,
                 0.0,
                 {}});
  const std::string bunny = "stanford/bun_zipper.ply.xz", dragon = "stanford/dragon_vrip_res2.ply.gz";
  const auto scan = [](std::string name, std::string about, const std::string& file, double noise) {
    return DataSet{std::move(name), std::move(about), file, file, Stroke::kWeave, true, noise, {}};
  };
  all.push_back(scan("bunny", "bunny, off its vertices", bunny, 0.0));
  all.push_back(scan("bunnyn", "bunny, off its vertices, noise .15", bunny, 0.15));
  all.push_back(scan("dragon", "dragon, off its vertices", dragon, 0.0));
  all.push_back(scan("dragonn", "dragon, off its vertices, noise .15", dragon, 0.15));
  DataSet merged = scan("bunnyraw", "ten raw scans of the bunny, merged", bunny, 0.0);
  merged.raw = "stanford/bunny_range_merged.ply.xz";
  all.push_back(std::move(merged));
  return all;
}

}  // namespace

const std::vector<DataSet>& data_sets() {
  static const std::vector<DataSet> kAll = all_sets();
  return kAll;
}

const DataSet* find_set(std::string_view name) {
  for (const DataSet& set : data_sets())
    if (set.name == name) return &set;
  return nullptr;
}

Result<DataSet> choose_set(const std::string& name, std::uint64_t seed) {
  DataSet set;
  if (const DataSet* const known = find_set(name)) {
    set = *known;
  } else if (cloud::find_generator(name.substr(0, name.find(':'))) != nullptr) {
    set.name = set.about = name;
    PALPATE_ASSIGN(const NamedOptions named, parse_named_options(name));
    set.generate = set.quick = name + (named.options.has("mesh") ? "" : ":mesh=false");
  } else {
    return Error{fmt::format("there is no set '{}'", name),
                 "choose from " + joined(names_of(data_sets())) + ", or give a generator with its options"};
  }
  set.seed = seed;
  // Deterministic generators take no seed; explicit seeds stay.
  const auto by_chance = [](const std::string& text) {
    return text.find("sampling=") != std::string::npos || text.find("noise=") != std::string::npos ||
           text.find("shuffle") != std::string::npos;
  };
  if (seed != 0 && by_chance(set.generate) && set.generate.find(":seed=") == std::string::npos) {
    set.generate += fmt::format(":seed={}", 1 + seed);
    set.quick += fmt::format(":seed={}", 1 + seed);
  }
  return set;
}

}  // namespace palpate::felt
