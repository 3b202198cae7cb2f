# Debian packages. `cpack` in a build folder writes tessera (client), tessera-coordinator and tessera-worker to packages/.
# Only packages get what is installed here: these rules are EXCLUDE_FROM_ALL.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "Tessera maintainers <maintainers@tessera.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "refinement of semantic 3D city meshes from aerial images")
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_PROJECT_CONFIG_FILE ${CMAKE_CURRENT_LIST_DIR}/package_version.cmake)
set(CPACK_TESSERA_SOURCE_DIR ${PROJECT_SOURCE_DIR})  # for package_version.cmake
set(CPACK_SET_DESTDIR ON)  # for files in /etc
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL client coordinator worker)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

# ca-certificates: S3 stores are reached by HTTPS.
set(CPACK_DEBIAN_CLIENT_PACKAGE_NAME tessera)
set(CPACK_DEBIAN_CLIENT_PACKAGE_DEPENDS ca-certificates)
# `tessera run` starts the other two programs from its own folder.
set(CPACK_DEBIAN_CLIENT_PACKAGE_RECOMMENDS "tessera-coordinator, tessera-worker")
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "The client of Tessera checks and imports scenes, submits jobs to a
coordinator, fetches and exports results. With tessera-coordinator and
tessera-worker, it also refines a scene on one machine (tessera run).")
set(CPACK_DEBIAN_COORDINATOR_PACKAGE_NAME tessera-coordinator)
set(CPACK_DEBIAN_COORDINATOR_PACKAGE_DEPENDS "adduser, ca-certificates")
set(CPACK_COMPONENT_COORDINATOR_DESCRIPTION "The coordinator of Tessera holds jobs and results and leases tasks to
workers. Its service, tesserad, is off until it is enabled.
/usr/share/doc/tessera-coordinator/OPERATING.md tells how to operate it.")
set(CPACK_DEBIAN_WORKER_PACKAGE_NAME tessera-worker)
set(CPACK_DEBIAN_WORKER_PACKAGE_DEPENDS "adduser, ca-certificates")
set(CPACK_COMPONENT_WORKER_DESCRIPTION "A worker of Tessera leases tasks of a coordinator and runs them. Its
service, tessera-worker, is off until it is enabled.")

# packaged_file(COMPONENT FOLDER FILE...)
function(packaged_file COMPONENT FOLDER)
  install(FILES ${ARGN} DESTINATION ${FOLDER} COMPONENT ${COMPONENT} EXCLUDE_FROM_ALL)
endfunction()

# The service of a package: unit, user, /etc/tessera/ENVIRONMENT, maintainer scripts. PREPARE makes folders at
# configuration; PURGED are those that purging deletes, SECRETS those of /etc/tessera that only root can read at first.
function(packaged_service COMPONENT PACKAGE)
  cmake_parse_arguments(ARG "" "UNIT;ENVIRONMENT;PREPARE;PURGED" "SECRETS" ${ARGN})
  set(deploy ${PROJECT_SOURCE_DIR}/deploy)
  set(made ${CMAKE_BINARY_DIR}/debian/${PACKAGE})
  packaged_file(${COMPONENT} lib/systemd/system ${deploy}/systemd/${ARG_UNIT})
  packaged_file(${COMPONENT} /etc/tessera ${deploy}/systemd/${ARG_ENVIRONMENT})
  configure_file(${deploy}/systemd/sysusers.conf ${made}/${PACKAGE}.conf COPYONLY)
  packaged_file(${COMPONENT} lib/sysusers.d ${made}/${PACKAGE}.conf)
  foreach(folder ${ARG_SECRETS})
    install(DIRECTORY DESTINATION /etc/tessera/${folder} DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE
      COMPONENT ${COMPONENT} EXCLUDE_FROM_ALL)
  endforeach()
  foreach(script postinst prerm postrm)
    configure_file(${deploy}/debian/${script}.in ${made}/${script} @ONLY)
    list(APPEND control ${made}/${script})
  endforeach()
  file(CONFIGURE OUTPUT ${made}/conffiles CONTENT "/etc/tessera/${ARG_ENVIRONMENT}\n")
  string(TOUPPER ${COMPONENT} component)
  set(CPACK_DEBIAN_${component}_PACKAGE_CONTROL_EXTRA ${control} ${made}/conffiles PARENT_SCOPE)
endfunction()

packaged_service(coordinator tessera-coordinator UNIT tesserad.service ENVIRONMENT tesserad.env SECRETS keys secrets
  PREPARE "chown root:tessera /etc/tessera/keys
  chmod 750 /etc/tessera/keys
  install -d -o tessera -g tessera -m 700 /var/lib/tessera"
  PURGED "/etc/tessera/keys /etc/tessera/secrets /var/lib/tessera")
packaged_service(worker tessera-worker UNIT tessera-worker.service ENVIRONMENT worker.env SECRETS worker-secrets
  PREPARE "install -d -o tessera -g tessera -m 700 /var/cache/tessera-worker"
  PURGED "/etc/tessera/worker-secrets /var/cache/tessera-worker")

set(deploy ${PROJECT_SOURCE_DIR}/deploy)
# The changelog, manual pages and completions are made when the first component is installed: cpack takes them in
# alphabetical order.
set(made ${CMAKE_BINARY_DIR}/debian)
install(CODE "set(CHANGELOG ${made}/changelog.Debian)
  set(RELEASE ${CPACK_DEBIAN_PACKAGE_RELEASE})
  set(CONTACT \"${CPACK_PACKAGE_CONTACT}\")
  set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
  set(CPACK_TESSERA_SOURCE_DIR ${PROJECT_SOURCE_DIR})
  include(${deploy}/cmake/write_changelog.cmake)
  execute_process(COMMAND ${deploy}/manual/make-manual ${CMAKE_RUNTIME_OUTPUT_DIRECTORY} ${made}/manual ${PROJECT_VERSION}
    COMMAND_ERROR_IS_FATAL ANY)" COMPONENT client EXCLUDE_FROM_ALL)
foreach(component client coordinator worker)
  string(TOUPPER ${component} name)
  packaged_file(${component} share/doc/${CPACK_DEBIAN_${name}_PACKAGE_NAME} ${deploy}/debian/copyright
    ${made}/changelog.Debian.gz)
endforeach()
install(DIRECTORY ${made}/manual/man1 DESTINATION share/man COMPONENT client EXCLUDE_FROM_ALL)
packaged_file(coordinator share/man/man8 ${made}/manual/man8/tesserad.8.gz)
packaged_file(worker share/man/man8 ${made}/manual/man8/tessera-worker.8.gz)
set(completions share/bash-completion/completions)
packaged_file(client ${completions} ${made}/manual/completions/tessera)
packaged_file(coordinator ${completions} ${made}/manual/completions/tesserad)
packaged_file(worker ${completions} ${made}/manual/completions/tessera-worker)
packaged_file(coordinator share/doc/tessera-coordinator ${deploy}/OPERATING.md ${deploy}/alarms.yml)
if(EXISTS ${deploy}/slurm/pilot)
  install(PROGRAMS ${deploy}/slurm/pilot DESTINATION lib/tessera/slurm COMPONENT worker EXCLUDE_FROM_ALL)
  packaged_file(worker share/doc/tessera-worker ${deploy}/slurm/README.md)
endif()
include(CPack)
