#include "tests/house/corpus_scene.h"

#include <gtest/gtest.h>

#include <utility>

#include "toolkit/io/read_model.h"
#include "toolkit/trace/trace_io.h"

namespace palpate::house {

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
  auto path = trace::read_path_csv(corpus_folder() + path_file);
  EXPECT_TRUE(path.ok()) << path.error().message();
  return {*std::move(loaded), *std::move(path)};
}

}  // namespace palpate::house
