// Trace hashes of every registered renderer on small models and paths from disk, equal in every build and for
// any number of preparation threads. A change that moves a hash must change the pinned list
// (tests/corpus/traces/README.md).
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/options.h>
#include <palpate/read_model.h>
#include <palpate/replay.h>
#include "tests/house/all_renderers.h"
#include "tests/house/corpus_scene.h"
#include "toolkit/io/byte_source.h"

namespace palpate::house {
namespace {

constexpr const char* kRefused = "refused";  // listed if a renderer refuses the scene

const std::vector<std::pair<std::string, std::string>> kStands = {
    {"torus.toml", "torus.csv"}, {"ridge.toml", "ridge.csv"},   {"plate.toml", "plate.csv"},
    {"dent.toml", "torus.csv"},  {"surface.toml", "ridge.csv"}, {"texture.toml", "ridge.csv"},
    {"many.toml", "torus.csv"},  {"formula.toml", "plate.csv"},
};

/// Options that change the frame's code or data, besides every renderer's defaults. Meshes are the files'
/// own: reconstruction has its own tests.
const std::vector<std::string> kFurther = {
    "cloud-vertices:shading=none", "cloud-vertices:neighbours=exact-knn", "cloud-vertices:partition=octree",
    "cloud-literal:shading=area-raw"};

NamedOptions with_own_mesh(NamedOptions named, const render::RendererInfo& info) {
  for (const OptionSpec& option : info.options)
    if (option.key == "mesh" && !named.options.has("mesh")) named.options.set("mesh", "original");
  return named;
}

std::string hash_of(const render::Registry& registry, const NamedOptions& named, const CorpusScene& loaded,
                    int threads) {
  std::unique_ptr<render::HapticRenderer> renderer = registry.make(named.name, named.options).value();
  if (!renderer->prepare(loaded.scene.input, {threads, nullptr})) return kRefused;
  return trace::trace_hash(
      trace::replay(*renderer, loaded.path, loaded.scene.input.simulation.get()).value());
}

using Pins = std::map<std::string, std::string>;

Pins read_pins() {
  Pins pins;
  std::ifstream file(corpus_folder() + "hashes.txt");
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string scene, path, renderer, hash;
    if (words >> scene >> path >> renderer >> hash)
      pins[fmt::format("{} {} {}", scene, path, renderer)] = hash;
  }
  return pins;
}

TEST(PinnedTraces, EveryRendererGivesThePinnedHash) {
  render::Registry registry;
  register_all_renderers(registry);
  std::vector<std::string> wanted = kFurther;
  for (const render::RendererInfo& info : registry.all()) wanted.push_back(info.name);
  const char* const write = std::getenv("PALPATE_PIN_TRACES");
  const Pins pins = read_pins();
  Pins found;
  std::set<std::string> hashed;  // names with at least one hash
  for (const auto& [scene_file, path_file] : kStands) {
    const CorpusScene loaded = load_corpus(scene_file, path_file);
    for (const std::string& text : wanted) {
      const NamedOptions plain = parse_named_options(text).value();
      const render::RendererInfo* const info = registry.find(plain.name);
      if (info == nullptr) continue;  // built without the baselines
      const NamedOptions named = with_own_mesh(plain, *info);
      const std::string key = fmt::format("{} {} {}", scene_file, path_file, text);
      const std::string hash = hash_of(registry, named, loaded, 1);
      EXPECT_EQ(hash_of(registry, named, loaded, 3), hash) << key << ": three threads of preparation";
      if (hash != kRefused) hashed.insert(plain.name);
      found[key] = hash;
      if (write != nullptr) continue;
      const auto pin = pins.find(key);
      if (pin == pins.end()) {
        ADD_FAILURE() << key << " is not pinned; it gives " << hash;
      } else {
        EXPECT_EQ(hash, pin->second) << key;
      }
    }
  }
  for (const render::RendererInfo& info : registry.all())
    EXPECT_EQ(hashed.count(info.name), 1u) << info.name << " is refused everywhere: nothing of it is pinned";
  if (write != nullptr) {
    std::ofstream file(write);
    for (const auto& [key, hash] : found) file << key << ' ' << hash << '\n';
    ASSERT_TRUE(file.good()) << write;
  }
#ifdef PALPATE_WITH_BASELINES
  EXPECT_EQ(found.size(), write != nullptr ? found.size() : pins.size()) << "a line that nobody gives";
#endif
}

std::string as_bytes(float value) {
  std::string bytes(sizeof(value), '\0');
  std::memcpy(bytes.data(), &value, sizeof(value));
  return bytes;
}

/// A cloud's points as binary 32-bit floats below the format's header.
std::string in_single_precision(const cloud::Cloud& cloud, const std::string& ending) {
  const std::size_t n = cloud.size();
  std::string bytes = ending == "ply"
                          ? fmt::format(
                                "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n"
                                "property float y\nproperty float z\nend_header\n",
                                n)
                          : fmt::format(
                                "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\n"
                                "SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {0}\nHEIGHT 1\n"
                                "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA binary\n",
                                n);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3f p = cloud.point_mm(i).cast<float>();
    bytes += as_bytes(p.x()) + as_bytes(p.y()) + as_bytes(p.z());
  }
  return bytes;
}

// 32-bit floats from any file format give the hash of the same floats from memory.
TEST(PinnedTraces, AreThoseOfPointsFromFilesInSinglePrecision) {
  render::Registry registry;
  register_all_renderers(registry);
  io::Readers readers;
  io::add_standard_readers(readers);
  std::vector<std::string> endings = {"ply"};
#ifdef PALPATE_WITH_PCD
  pcd::add_pcd_reader(readers);
  endings.emplace_back("pcd");
#endif
  const Pins pins = read_pins();
  io::ReadOptions options;
  options.unit = io::Unit::kMillimetre;
  std::size_t compared = 0;
  for (const auto& [scene_file, path_file] :
       {kStands[0], kStands[1], kStands[2]}) {  // one model, plain: torus, ridge, plate
    for (const std::string& ending : endings) {
      CorpusScene loaded = load_corpus(scene_file, path_file);
      const std::string bytes = in_single_precision(*loaded.scene.input.models.front().cloud, ending);
      const auto read = readers.read(std::make_unique<io::MemorySource>(std::as_bytes(std::span(bytes))),
                                     "points." + ending, options);
      ASSERT_TRUE(read) << read.error().message();
      loaded.scene.input.models.front().cloud = std::make_shared<const cloud::Cloud>(read->cloud);
      for (const render::RendererInfo& info : registry.all()) {
        if (info.role != render::Role::kOurs) continue;
        const auto pin = pins.find(fmt::format("{} {} {}", scene_file, path_file, info.name));
        if (pin == pins.end() || pin->second == kRefused) continue;
        CorpusScene direct = load_corpus(scene_file, path_file);
        std::vector<Vec3> points;
        const cloud::Cloud& exact = *direct.scene.input.models.front().cloud;
        for (std::size_t i = 0; i < exact.size(); ++i)
          points.push_back(exact.point_mm(i).cast<float>().cast<double>());
        direct.scene.input.models.front().cloud = std::make_shared<const cloud::Cloud>(
            cloud::build_cloud(points, cloud::NonFinite::kRefuse).value());
        EXPECT_EQ(hash_of(registry, {info.name, {}}, loaded, 1),
                  hash_of(registry, {info.name, {}}, direct, 2))
            << scene_file << ", " << ending << ", " << info.name;
        ++compared;
      }
    }
  }
  // Three models for both clouds, and the ridge for height fields.
  EXPECT_GE(compared, 7 * endings.size());
}

}  // namespace
}  // namespace palpate::house
