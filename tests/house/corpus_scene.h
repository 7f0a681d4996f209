// The small models and paths of tests/corpus/traces, read from disk.
#pragma once

#include <string>

#include "toolkit/scene/scene.h"
#include "toolkit/trace/trace.h"

namespace palpate::house {

/// A scene of the corpus and a path over it; a test fails where one cannot be read.
struct CorpusScene {
  scene::LoadedScene scene;
  trace::ProbePath path;
};
[[nodiscard]] CorpusScene load_corpus(const std::string& scene_file, const std::string& path_file);

/// Where the corpus lies, with a slash at its end.
[[nodiscard]] std::string corpus_folder();

}  // namespace palpate::house
