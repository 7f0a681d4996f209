#include "experiments/data/fetch.h"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "experiments/command/commands.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {
namespace {

constexpr double kBytesPerMb = 1e6;

void print_json() {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Scan& scan : known_scans()) {
    nlohmann::ordered_json sources = nlohmann::ordered_json::array();
    for (const ScanSource& s : scan.sources)
      sources.push_back(
          {{"address", s.address}, {"member", s.member}, {"file", s.file}, {"sha256", s.sha256}});
    const auto found = locate_scan(scan);
    nlohmann::ordered_json entry = {{"name", scan.name},     {"what", scan.what},   {"unit", scan.unit},
                                    {"points", scan.points}, {"bytes", scan.bytes}, {"licence", scan.licence},
                                    {"terms", scan.terms},   {"home", scan.home},   {"sources", sources}};
    entry["found"] = found ? nlohmann::ordered_json(found->string()) : nlohmann::ordered_json(nullptr);
    list.push_back(entry);
  }
  fmt::print("{}\n", list.dump(2));
}

void print_list() {
  for (const Scan& scan : known_scans()) {
    const auto found = locate_scan(scan);
    const std::string size = scan.bytes > 0
                                 ? fmt::format(", {:.1f} MB", static_cast<double>(scan.bytes) / kBytesPerMb)
                                 : std::string();
    fmt::print("{}\n  {}\n  {} points{}, unit {}\n  licence: {}\n", scan.name, scan.what, scan.points, size,
               scan.unit, scan.licence);
    for (const ScanSource& s : scan.sources)
      fmt::print("  from {}  ({}, sha256 {})\n", s.address, s.file,
                 s.sha256.empty() ? "not known: recorded when it first comes" : s.sha256);
    fmt::print("  {}\n", found ? "here: " + found->string() : "not here yet: palpate fetch " + scan.name);
  }
}

/// The scan with one source instead of its own: a mirror, or a file at hand. Which checksum holds goes by the
/// name.
Scan from_address(Scan scan, const std::string& address) {
  const auto ends = [&](std::string_view tail) {
    return address.size() >= tail.size() && address.ends_with(tail);
  };
  ScanSource chosen = scan.sources.front();
  for (const ScanSource& source : scan.sources) {
    const bool zipped = source.file.ends_with(".gz");
    if (ends(".tgz")      ? source.kind == ScanSource::Kind::kNpm
        : ends(".tar.gz") ? source.kind == ScanSource::Kind::kAddress
                          : zipped == ends(".gz"))
      chosen = source;
  }
  chosen.kind = ScanSource::Kind::kAddress;
  chosen.address = address;
  if (!ends(".tgz") && !ends(".tar.gz")) chosen.member.clear();
  scan.sources = {chosen};
  return scan;
}

}  // namespace

int run_fetch(const FetchArguments& arguments, Context& context) {
  if (arguments.name.empty()) {
    arguments.json ? print_json() : print_list();
    return kExitOk;
  }
  const Scan* known = find_scan(arguments.name);
  if (known == nullptr) {
    std::vector<std::string> names;
    for (const Scan& scan : known_scans()) names.push_back(scan.name);
    const std::string near = scene::nearest_name(arguments.name, names);
    return fail({fmt::format("no scan is called '{}'", arguments.name),
                 near.empty() ? "`palpate fetch` lists them" : fmt::format("did you mean '{}'?", near),
                 {},
                 0},
                kExitBadInput);
  }
  if (arguments.source.empty()) {
    if (const auto found = locate_scan(*known)) {
      fmt::print("{} is here already: {}\n", known->name, found->string());
      return kExitOk;
    }
  }
  const Scan scan = arguments.source.empty() ? *known : from_address(*known, arguments.source);
  fmt::print("{}: {}\n{}\n", scan.name, scan.what, scan.terms);
  std::fflush(stdout);
  FetchOptions options;
  options.cache = cache_folder();
  const Result<std::filesystem::path> got = fetch_scan(scan, options, context.progress);
  context.progress.clear();
  if (!got) return fail(got.error(), kExitFellShort);
  if (scan.sources.size() == 1 && scan.sources.front().sha256.empty())
    fmt::print("stored; no checksum is known, this one was recorded for next time: {}\n  {}\n",
               checksum_record(*got).string(), got->string());
  else
    fmt::print("stored, checksum right: {}\n", got->string());
  return kExitOk;
}

}  // namespace palpate::experiments
