// What a person must know before reading any number of a result: warnings first, then notes.
#pragma once

#include <string>
#include <vector>

#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

/// Warnings of the scene and the path, then those of every renderer's preparation, with the labels it holds
/// for: "cloud, cloud-smooth: ...". Each text once.
[[nodiscard]] std::vector<std::string> warnings_of(const metrics::ResultDocument& document);

/// warnings_of() and the notes of scene and path, a line each: "palpate: warning: ...", "palpate: note: ...".
[[nodiscard]] std::string findings_text(const metrics::ResultDocument& document);

}  // namespace palpate::experiments
