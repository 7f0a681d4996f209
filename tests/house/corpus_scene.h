// Small models and paths of tests/corpus/traces.
#pragma once

#include <string>

#include <palpate/scene.h>
#include <palpate/trace.h>

namespace palpate::house {

/// A scene of the corpus with a path; a test fails if one cannot be read.
struct CorpusScene {
  scene::LoadedScene scene;
  trace::ProbePath path;
};
[[nodiscard]] CorpusScene load_corpus(const std::string& scene_file, const std::string& path_file);

/// The corpus folder, with a final slash.
[[nodiscard]] std::string corpus_folder();

}  // namespace palpate::house
