// The suite run with several renderers: a matrix, and a picture for each behaviour.
#pragma once

#include <string>
#include <vector>

#include "experiments/behaviours/behaviour.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

struct BehaviourMatrix {
  std::vector<Behaviour> behaviours;
  std::vector<RendererRequest> renderers;
  std::vector<std::vector<BehaviourOutcome>> outcomes;  ///< by renderer, then behaviour
  std::vector<render::Role> roles{};                    ///< by renderer
};

/// Every renderer that is one of the methods: all of the registry but the truth and the oracle of tests.
[[nodiscard]] std::vector<RendererRequest> methods_of(const render::Registry& registry);

/// Where the rows of a matrix are kept as they are finished, so that a run can go on from an interrupted one.
struct KeptRows {
  using Row = std::vector<BehaviourOutcome>;
  std::function<bool(const RendererRequest&, Row&)> find;
  std::function<Status(const RendererRequest&, const Row&)> keep;
};

/// Runs everything that is not found among `kept`. An Error is one of keeping.
[[nodiscard]] Result<BehaviourMatrix> run_behaviours(std::vector<Behaviour> behaviours,
                                                     std::vector<RendererRequest> renderers,
                                                     const render::Registry& registry, int threads,
                                                     Progress& progress, const KeptRows* kept = nullptr);

/// A row as a text, and back; false where the text is none.
[[nodiscard]] std::string to_text(const KeptRows::Row& row);
[[nodiscard]] bool from_text(const std::string& text, KeptRows::Row& row);

/// One row a renderer, with its role, and one column a behaviour: "wrong of all".
[[nodiscard]] Table matrix_table(const BehaviourMatrix& matrix);
[[nodiscard]] std::string matrix_json(const BehaviourMatrix& matrix);
/// One section with the matrix and the pictures, drawn into `folder`/figures.
void add_behaviours(Page& page, const BehaviourMatrix& matrix, const OutputFolder& folder);

}  // namespace palpate::experiments
