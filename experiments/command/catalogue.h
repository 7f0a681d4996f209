// Lists of things with options: renderers, cleaning steps.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "toolkit/core/options.h"

namespace palpate::experiments {

struct CatalogueEntry {
  std::string name;
  std::string summary;
  std::string source;
  std::span<const OptionSpec> options;
  std::optional<bool> needs_analytic;  ///< of renderers
};

/// For a person, or as JSON.
void print_catalogue(std::span<const CatalogueEntry> entries, bool json);

}  // namespace palpate::experiments
