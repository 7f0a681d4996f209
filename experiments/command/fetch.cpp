#include "experiments/data/scans.h"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include <palpate/progress.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/session/session.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr double kBytesPerMb = 1e6;

nlohmann::ordered_json json_of(const Scan& scan) {
  nlohmann::ordered_json sources = nlohmann::ordered_json::array();
  for (const ScanSource& s : scan.sources)
    sources.push_back({{"address", s.address}, {"member", s.member}, {"file", s.file}, {"sha256", s.sha256}});
  const auto found = locate_scan(scan);
  nlohmann::ordered_json entry = {{"name", scan.name},     {"what", scan.what},   {"unit", scan.unit},
                                  {"points", scan.points}, {"bytes", scan.bytes}, {"licence", scan.licence},
                                  {"terms", scan.terms},   {"home", scan.home},   {"sources", sources}};
  entry["found"] = found ? nlohmann::ordered_json(found->string()) : nlohmann::ordered_json(nullptr);
  return entry;
}

struct ScansArguments {
  bool json = false;
};

void declare_scans(const Declaration& declare, ScansArguments& a) {
  declare_json(declare, a.json);
}

void print_json() {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Scan& scan : known_scans()) list.push_back(json_of(scan));
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

/// The scan with one source instead of its own: a mirror, or a file at hand. The name decides the checksum.
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

/// Whether the scan is here or not: the address was asked for.
Result<BroughtScan> fetch_from(const Scan& scan, const FetchOptions& options, Progress& progress) {
  Result<std::filesystem::path> got = fetch_scan(scan, options, progress);
  if (!got) return std::move(got).error();
  return BroughtScan{*std::move(got), true, {}};
}

struct FetchArguments {
  std::string name;
  std::string source;          ///< an address to take it from instead
  double size_limit_gb = 0.0;  ///< of the download; 0: kDownloadLimitBytes
  bool force = false;          ///< fetched though it is here
  bool json = false;
};

void declare_fetch(const Declaration& declare, FetchArguments& a) {
  declare.required("NAME", a.name, "name of the scan (`palpate list scans`)");
  declare.text("--source", a.source, "take it from this address (http, https, file) instead");
  declare.flag("--force", a.force, "fetch it again, and keep it even if it differs from an earlier fetch");
  declare.number("--size-limit-gb", a.size_limit_gb, kGigabytes,
                 fmt::format("largest download, GB, also when unpacked (default: {:.3g})",
                             static_cast<double>(kDownloadLimitBytes) / kBytesPerGb));
  declare_json(declare, a.json);
}

int run_scans(const ScansArguments& arguments, Context& /*context*/) {
  arguments.json ? print_json() : print_list();
  return kExitOk;
}

Result<int> run_fetch(const FetchArguments& arguments, Context& context) {
  const bool of_download = !arguments.source.empty() || arguments.force || arguments.size_limit_gb > 0.0;
  const Scan* known = find_scan(arguments.name);
  if (known == nullptr) return no_such_scan(arguments.name);
  const Scan scan = arguments.source.empty() ? *known : from_address(*known, arguments.source);
  // Where results are printed for a program, what is for a person goes elsewhere.
  std::FILE* const to_person = arguments.json ? stderr : stdout;
  if (of_download || !locate_scan(scan))
    fmt::print(to_person, "{}: {}\n{}\n", scan.name, scan.what, scan.terms);
  std::fflush(to_person);
  const io::Readers readers = all_readers();
  const StopCallback stop_callback(
      [] { return std::string("what has come is kept; the same command goes on from there"); });
  FetchOptions options;
  options.cache = cache_folder();
  options.readers = &readers;
  options.force = arguments.force;
  if (arguments.size_limit_gb > 0.0)
    options.download_limit_bytes = static_cast<std::uint64_t>(arguments.size_limit_gb * kBytesPerGb);
  context.working = true;
  PALPATE_ASSIGN(const BroughtScan got, arguments.source.empty()
                                            ? bring_scan(scan, options, context.progress)
                                            : fetch_from(scan, options, context.progress));
  context.progress.clear();
  if (!got.note.empty()) tell("palpate: note: {}\n", got.note);
  const std::filesystem::path record = checksum_record(got.file);
  std::error_code code;
  if (arguments.json)
    fmt::print("{}\n", json_of(*known).dump(2));
  else if (!got.fetched)
    fmt::print("{} is here already: {}\n", scan.name, got.file.string());
  else if (std::filesystem::exists(record, code))
    fmt::print("stored; no checksum is known, this one was recorded for next time: {}\n  {}\n",
               record.string(), got.file.string());
  else
    fmt::print("stored, checksum right: {}\n", got.file.string());
  return kExitOk;
}

}  // namespace

Subcommand fetch_subcommand() {
  return subcommand("fetch", "downloads a known scan into the cache, and checks it",
                    {"palpate fetch stanford-dragon", "palpate fetch stanford-dragon --force"}, declare_fetch,
                    run_fetch);
}

Subcommand scans_subcommand() {
  return subcommand("list scans", "known scans: size, licence, sources, where each is",
                    {"palpate list scans", "palpate list scans --json"}, declare_scans, run_scans);
}

}  // namespace palpate::experiments
