// Lists of things with options: renderers, cleaning steps, path generators.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::experiments {

struct CatalogueEntry {
  std::string name;
  std::string summary;
  std::string source;  ///< may be empty
  std::span<const OptionSpec> options;
  std::string role{}, works_on{};       ///< of renderers: render::Role and render::Geometry
  std::vector<std::string> supports{};  ///< of renderers: what a scene may ask of it
  std::string models{};                 ///< on which it works, where that must be said
  std::string example{};                ///< as on a command line; may be empty
};

/// Keeps the one of this name alone; all where it is empty. An Error where there is none, with what may have
/// been meant.
[[nodiscard]] Status keep_named(std::vector<CatalogueEntry>& entries, const std::string& name);

/// For a person, or as JSON.
void print_catalogue(std::span<const CatalogueEntry> entries, bool json);

}  // namespace palpate::experiments
