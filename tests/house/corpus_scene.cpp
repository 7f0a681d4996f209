#include "tests/house/corpus_scene.h"

#include <gtest/gtest.h>
#include <unistd.h>
#include <zlib.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <utility>

#include <palpate/read_model.h>
#include <palpate/trace.h>

namespace palpate::house {
namespace {

/// The text of a compressed file, as a file of its own until the object ends.
class Expanded {
 public:
  explicit Expanded(const std::string& name)
      : file_(std::filesystem::path(testing::TempDir()) / ("corpus-" + std::to_string(::getpid()) + ".csv")) {
    std::ofstream text(file_, std::ios::binary);
    const gzFile packed = ::gzopen(name.c_str(), "rb");
    EXPECT_NE(packed, nullptr) << name;
    if (packed == nullptr) return;
    std::array<char, 4096> block{};
    int n = 0;
    while ((n = ::gzread(packed, block.data(), block.size())) > 0) text.write(block.data(), n);
    EXPECT_EQ(n, 0) << name << " is damaged";
    ::gzclose(packed);
  }
  Expanded(const Expanded&) = delete;
  Expanded& operator=(const Expanded&) = delete;
  ~Expanded() { std::filesystem::remove(file_); }
  [[nodiscard]] std::string file() const { return file_.string(); }

 private:
  std::filesystem::path file_;
};

}  // namespace

std::string corpus_folder() {
  return std::string(PALPATE_SOURCE_ROOT) + "/tests/corpus/traces/";
}

CorpusScene load_corpus(const std::string& scene_file, const std::string& path_file) {
  const auto scene = scene::read_scene(corpus_folder() + scene_file);
  EXPECT_TRUE(scene.ok()) << scene.error().message();
  io::Readers readers;
  io::add_standard_readers(readers);
  auto loaded = scene::load(*scene, readers, {}, no_progress());
  EXPECT_TRUE(loaded.ok()) << loaded.error().message();
  const Expanded text(corpus_folder() + path_file + ".gz");
  auto path = trace::read_path_csv(text.file());
  EXPECT_TRUE(path.ok()) << path.error().message();
  return {*std::move(loaded), *std::move(path)};
}

NamedOptions with_own_mesh(NamedOptions named, const render::RendererInfo& info) {
  for (const OptionSpec& option : info.options)
    if (option.key == "mesh" && !named.options.has("mesh")) named.options.set("mesh", "original");
  return named;
}

}  // namespace palpate::house
