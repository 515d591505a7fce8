/** What build.mjs defines. */

/** Versions of the packages in the bundle, by their names. */
declare const VERSIONS: Record<string, string>;
/** Paths of all files of the site but the service worker. */
declare const FILES: string[];
/** Hash of all files, which is also what version.txt holds. */
declare const VERSION: string;
/** What `send_preset` of web/host/tables.py says of each preset. */
declare const SENT: any[];
