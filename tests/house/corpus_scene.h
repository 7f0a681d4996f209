// Small models and paths of tests/corpus/traces.
#pragma once

#include <string>

#include <palpate/options.h>
#include <palpate/registry.h>
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

/// A renderer that needs a mesh feels the file's own, unless its options name another: reconstruction has its
/// own tests.
[[nodiscard]] NamedOptions with_own_mesh(NamedOptions named, const render::RendererInfo& info);

// All renderers of this build: the toolkit's, and the baselines' if built.

[[nodiscard]] render::Registry all_renderers();

}  // namespace palpate::house
