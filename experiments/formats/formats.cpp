// The module palpate-formats.so: the readers that bring half a distribution with them. Of 180 shared
// libraries that a command used to load, and 0.25 of its 0.35 s, most were GDAL's and PCL's; now a command
// loads them when a file asks for them. See experiments/session/session.h.
#include <palpate/read_model.h>
#ifdef PALPATE_WITH_DEM
#endif
#ifdef PALPATE_WITH_PCD
#endif

// The one symbol. Both sides are of one build: objects may cross.
extern "C" __attribute__((visibility("default"))) void palpate_add_formats(palpate::io::Readers& readers) {
#ifdef PALPATE_WITH_PCD
  palpate::pcd::add_pcd_reader(readers);
#endif
#ifdef PALPATE_WITH_DEM
  palpate::dem::add_dem_readers(readers);
#endif
}
