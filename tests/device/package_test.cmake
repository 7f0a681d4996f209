# Packs the rules of udev as `cpack` packs everything, as an archive and, where dpkg is there, as a Debian package, and
# demands each file where the system looks for it, byte by byte.
#
#   cmake -DBUILD=build/release -DSOURCE=. -DCPACK=cpack -P tests/device/package_test.cmake
set(folder "${BUILD}/package_test")
set(rules lib/udev/rules.d/70-palpate.rules)
file(REMOVE_RECURSE "${folder}")
file(MAKE_DIRECTORY "${folder}/unpacked")

function(pack generator components)
  execute_process(COMMAND "${CPACK}" --config "${BUILD}/CPackConfig.cmake" -G ${generator} -B "${folder}"
      -D "CPACK_INSTALL_CMAKE_PROJECTS=${BUILD};palpate;${components};/" -D CPACK_COMPONENTS_ALL=udev
    WORKING_DIRECTORY "${folder}" RESULT_VARIABLE failed OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(failed)
    message(FATAL_ERROR "cpack -G ${generator} failed: ${said}")
  endif()
endfunction()

function(demand_rules root)
  file(GLOB found "${root}/usr/${rules}")
  if(NOT found)
    message(FATAL_ERROR "the package in ${root} has no usr/${rules}")
  endif()
  file(SHA256 "${found}" packed)
  file(SHA256 "${SOURCE}/device/drivers/70-palpate.rules" ours)
  if(NOT packed STREQUAL ours)
    message(FATAL_ERROR "${found} is not device/drivers/70-palpate.rules")
  endif()
endfunction()

pack(TGZ udev)
file(GLOB archive "${folder}/palpate-*.tar.gz")
file(ARCHIVE_EXTRACT INPUT "${archive}" DESTINATION "${folder}/unpacked")
file(GLOB top "${folder}/unpacked/palpate-*")
demand_rules("${top}")

find_program(DPKG_DEB dpkg-deb)
if(NOT DPKG_DEB)
  message(STATUS "no dpkg-deb: the Debian package was not looked at")
  return()
endif()
pack(DEB ALL)
file(GLOB package "${folder}/palpate_*.deb")
execute_process(COMMAND "${DPKG_DEB}" --raw-extract "${package}" "${folder}/unpacked/deb" COMMAND_ERROR_IS_FATAL ANY)
demand_rules("${folder}/unpacked/deb")
file(SHA256 "${folder}/unpacked/deb/DEBIAN/postinst" packed)
file(SHA256 "${SOURCE}/device/drivers/package/postinst" ours)
if(NOT packed STREQUAL ours)
  message(FATAL_ERROR "the Debian package does not tell udev of its rules")
endif()
message(STATUS "archive and Debian package hold usr/${rules}")
