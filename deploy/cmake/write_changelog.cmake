# Writes CHANGELOG (compressed), the Debian changelog of PACKAGE, with one entry: the version that cpack packs.
include(${CMAKE_CURRENT_LIST_DIR}/package_version.cmake)
ask_git(date log -1 --format=%cD)
if(NOT date)
  execute_process(COMMAND date -R OUTPUT_VARIABLE date OUTPUT_STRIP_TRAILING_WHITESPACE)
endif()
file(WRITE ${CHANGELOG} "tessera (${CPACK_DEBIAN_PACKAGE_VERSION}-${RELEASE}) unstable; urgency=medium

  * Changes are in the repository's log.

 -- ${CONTACT}  ${date}
")
execute_process(COMMAND gzip -9nf ${CHANGELOG} COMMAND_ERROR_IS_FATAL ANY)
