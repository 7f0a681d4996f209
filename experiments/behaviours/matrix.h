// The behaviour suite, as a command for several renderers: a matrix and a picture per behaviour.
#pragma once

#include <string>
#include <vector>

#include "experiments/behaviours/behaviour.h"
#include "experiments/driver/suite.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

struct BehaviourMatrix {
  std::vector<Behaviour> behaviours;
  std::vector<RendererRequest> renderers;
  std::vector<std::vector<BehaviourOutcome>> outcomes;  ///< by renderer, then behaviour
  std::vector<render::Role> roles{};                    ///< by renderer
};

/// Every registered renderer except the truth and the tests' oracle.
[[nodiscard]] std::vector<RendererRequest> methods_of(const render::Registry& registry);

/// `suite`: keeps each renderer's row, and takes over those of an interrupted run. Error: storing failed.
[[nodiscard]] Result<BehaviourMatrix> run_behaviours(std::vector<Behaviour> behaviours,
                                                     std::vector<RendererRequest> renderers,
                                                     const render::Registry& registry, int threads,
                                                     Progress& progress, const Suite* suite = nullptr);

[[nodiscard]] std::string matrix_json(const BehaviourMatrix& matrix, const metrics::DocumentHead& head);
/// Adds a section with matrix and pictures, drawn into `folder`/figures.
void add_behaviours(Page& page, const BehaviourMatrix& matrix, const OutputFolder& folder);

struct BehavioursArguments {
  std::string renderers;  ///< empty: all methods
  std::string only;       ///< "thin-plate,ridge"; empty: all
  std::string out;
  int threads = 0;
  bool json = false;
};

/// Returns the exit status.
[[nodiscard]] Result<int> watch_behaviours(const BehavioursArguments& arguments, Context& context);

}  // namespace palpate::experiments
